import os
from dataclasses import replace

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Explanation, Stuck
from cutgrammar_workers.checked_planner import CheckedPlanner, MethodError, checked_action
from cutgrammar_workers.tasks import MAX_TEXT, attempt

PLANE = Plane(np.array([0.0, 0.0, 1.0]), 0.1)
WHY = Explanation((), "c1 -> c2", 0.0, 0.0, 0.0, (), 1, 0)
CUT = Cut(PLANE, np.zeros((1, 3)), WHY)


def test_a_good_action_is_passed_on_as_it_is():
    assert checked_action(CUT) is CUT
    assert checked_action(Stuck("no idea")) == Stuck("no idea")


def test_single_precision_becomes_double_precision():
    cut = checked_action(Cut(PLANE, np.full((1, 3), 0.25, dtype=np.float32)))
    assert isinstance(cut, Cut)
    assert cut.p_WC.dtype == np.float64
    assert cut.p_WC.tolist() == [[0.25] * 3]


@pytest.mark.parametrize(
    "action",
    [
        None,
        object(),
        "x" * 10**6,
        Stuck(None),
        Cut(np.zeros(4), np.zeros((1, 3))),
        Cut(PLANE, "here"),
        Cut(PLANE, np.full((1, 3), np.nan)),
        Cut(PLANE, np.zeros((0, 3))),
        Cut(PLANE, np.zeros((10**6, 3))),
        Cut(PLANE, np.zeros(3)),
        replace(CUT, explanation="because"),
        replace(CUT, explanation=replace(WHY, production=7)),
    ],
)
def test_what_is_no_action_is_refused_in_a_short_line(action):
    with pytest.raises(MethodError) as caught:
        checked_action(action)
    assert len(str(caught.value)) < 200


def test_text_that_cannot_be_stored_is_made_storable():
    assert checked_action(Stuck("a\ud800")) == Stuck("a\\ud800")
    assert (
        checked_action(replace(CUT, explanation=replace(WHY, production="\ud800"))).explanation.production == "\\ud800"
    )
    assert len(checked_action(Stuck("x" * 10**7)).reason) < MAX_TEXT + 10


class Raising:
    def __init__(self, error):
        self.error = error

    def next_cut(self, now, goal, refused, rng):
        raise self.error


def test_errors_that_would_end_the_run_end_the_trial_of_a_plugin():
    for error in (InputError("the mesh is open"), SystemExit(3)):
        with pytest.raises(MethodError, match="the method"):
            CheckedPlanner(lambda error=error: Raising(error), is_plugin=True).next_cut((), (), (), None)
    with pytest.raises(InputError):
        CheckedPlanner(lambda: Raising(InputError("train again")), is_plugin=False).next_cut((), (), (), None)


def test_a_forked_child_does_not_carry_out_the_trial_too():
    class Forking:
        def next_cut(self, now, goal, refused, rng):
            self.child = os.fork()
            return Stuck("forked")

    planner = Forking()
    assert CheckedPlanner(lambda: planner, is_plugin=True).next_cut((), (), (), None) == Stuck("forked")
    assert os.waitstatus_to_exitcode(os.waitpid(planner.child, 0)[1]) == 1


def test_an_exception_without_a_text_or_with_an_endless_one_is_a_crash():
    class MuteError(Exception):
        def __str__(self):
            raise ValueError("no text")

    def worker(error):
        raise error

    assert "MuteError" in attempt(worker, MuteError()).reason
    crashed = attempt(worker, ValueError("\ud800" + "x" * 10**7))
    assert len(crashed.reason.encode()) < MAX_TEXT + 10
    assert len(crashed.traceback.encode()) <= MAX_TEXT + 10
