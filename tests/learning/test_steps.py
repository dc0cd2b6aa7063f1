from types import SimpleNamespace

import numpy as np
import pytest

from cutgrammar.geometry.plane import Plane
from cutgrammar.learning.steps import steps_of


def cut_at(offset):
    return SimpleNamespace(plane_C=Plane(np.array([0.0, 0.0, 1.0]), offset))


TRIALS = (7, 7, 7, 7, 7, 4, 4, 4)
CUTS = [(0, (1, 2), cut_at(0.1)), (5, (6, 7), cut_at(0.3)), (2, (3, 4), cut_at(0.2))]
"""Trial 7: 0 becomes 1 and 2, 2 becomes 3 and 4. Trial 4: 5 becomes 6 and 7. Told out of order."""


@pytest.fixture
def steps():
    return steps_of(np.zeros((8, 4, 17)), TRIALS, CUTS)


def members(rows):
    return [row.tolist() for row in rows]


def test_steps_hold_the_current_fragments_the_goal_and_the_cut(steps):
    assert steps.trials.tolist() == [7, 7, 4]
    assert members(steps.now) == [[0], [1, 2], [5]]
    assert members(steps.goal) == [[1, 3, 4], [1, 3, 4], [6, 7]]
    assert steps.cut.tolist() == [0, 2, 5]
    assert steps.after.tolist() == [1, -1, -1]
    assert [plane.offset for plane in steps.planes_C] == [0.1, 0.2, 0.3]


def test_every_configuration_differs_from_the_one_before_only_in_the_fragment_cut(steps):
    for step, after in enumerate(steps.after):
        if after >= 0:
            left = set(members(steps.now)[step]) - {int(steps.cut[step])}
            assert left < set(members(steps.now)[after])


def test_the_steps_of_whole_objects_cut_what_no_cut_made(steps):
    assert steps.of_whole_objects.tolist() == [0, 2]


def test_steps_of_some_trials_follow_one_another_as_before(steps):
    last = steps.of(np.array([2]))
    assert (members(last.now), last.after.tolist(), last.planes_C[0].offset) == ([[5]], [-1], 0.3)
    first = steps.of(np.array([0, 1]))
    assert (first.after.tolist(), first.trials.tolist()) == ([1, -1], [7, 7])


def test_a_cut_of_a_fragment_that_does_not_exist_is_an_error():
    with pytest.raises(ValueError, match="fragment 0 of trial 7 was cut where it did not exist"):
        steps_of(np.zeros((8, 4, 17)), TRIALS, [*CUTS, (0, (1, 2), cut_at(0.0))])
    with pytest.raises(ValueError, match="no cuts"):
        steps_of(np.zeros((8, 4, 17)), TRIALS, [])
