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


def test_a_new_fragment_is_divided_by_the_last_cut_only_while_fragments_are_lacking():
    plane_W = Plane(np.array([1.0, 0.0, 0.0]), 0.0)
    assert len(held_to([found(0.0)], 1, plane_W)) == 1
    parts = held_to([found(0.0)], 2, plane_W)
    assert [part.fragment.mesh.volume for part in parts] == pytest.approx([1.35e-5, 1.35e-5])
    assert np.array_equal(np.sort(np.concatenate([part.members for part in parts])), np.arange(200))
    assert len(held_to([found(0.0)], 2, None)) == 1
    assert len(held_to([found(0.1)], 2, plane_W)) == 1


def test_of_more_new_fragments_than_were_lost_the_largest_are_taken():
    every = [found(0.0, count=50), found(0.1, count=300), found(0.2, count=200)]
    assert held_to(every, 2, None) == every[1:]
    assert held_to(every, 0, None) == []


def test_the_lost_fragment_that_no_new_one_resembles_is_hidden():
    lost = [block(0.0), block(0.1), block(0.1, side=0.06)]
    assert hidden(lost, [found(0.01), found(0.11, side=0.06)]) == [lost[1]]
    assert hidden(lost, []) == lost
    assert hidden([], [found(0.0)]) == []
