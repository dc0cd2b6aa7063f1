import numpy as np
import pytest

from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.perception.vision.belief import Believed
from cutgrammar.perception.vision.conservation import Found, held_to, hidden
from simple_shapes import box_mesh


def block(x, side=0.03, count=200, seed=0):
    middle = np.array([x, 0.0, side / 2])
    points = middle + np.random.default_rng(seed).uniform(-side / 2, side / 2, (count, 3))
    return Believed(box_mesh(side, side, side).moved(Pose(np.eye(3), middle)), points)


def found(x, side=0.03, count=200):
    return Found(block(x, side, count), np.arange(count))


def of_volume(cm3):
    """A completion that gives whatever points a block of this volume."""
    side = cm3 ** (1 / 3) * 1e-2
    return lambda members: Found(block(0.0, side, len(members)), members)


ACROSS = Plane(np.array([1.0, 0.0, 0.0]), 0.0)


def test_the_last_cut_divides_a_new_fragment():
    parts = held_to([found(0.0)], [block(0.0)] * 2, 2, ACROSS, of_volume(27.0))
    assert [part.fragment.mesh.volume for part in parts] == pytest.approx([1.35e-5, 1.35e-5])
    assert np.array_equal(np.sort(np.concatenate([part.members for part in parts])), np.arange(200))
    assert len(held_to([found(0.0)], [block(0.0)] * 2, 2, None, of_volume(27.0))) == 1
    assert len(held_to([found(0.1)], [block(0.0)] * 2, 2, ACROSS, of_volume(27.0))) == 1


def test_parts_are_joined_again_if_only_one_fragment_of_their_volume_was_lost():
    (joined,) = held_to([found(0.0)], [block(0.0)], 1, ACROSS, of_volume(27.0))
    assert np.array_equal(joined.members, np.arange(200))


def test_what_is_too_much_is_left_out_if_joining_gives_no_lost_volume():
    every = [found(0.0, count=300), found(0.1, side=0.005, count=20)]
    assert held_to(every, [block(0.0)], 1, None, of_volume(60.0)) == every[:1]
    assert held_to(every, [], 0, None, of_volume(60.0)) == []


def test_the_lost_fragment_that_no_new_one_resembles_is_hidden():
    lost = [block(0.0), block(0.1), block(0.1, side=0.06)]
    assert hidden(lost, [found(0.01), found(0.11, side=0.06)]) == [lost[1]]
    assert hidden(lost, []) == lost
    assert hidden([], [found(0.0)]) == []
