from itertools import pairwise

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.height_map import Heights, stamp_of
from cutgrammar_sim.arm.planning.paths import find_posture, straight
from cutgrammar_sim.arm.planning.transit import MARGIN, Surroundings, _grown, find_way
from cutgrammar_sim.arm.robot.collision import CollisionChecker
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())
CLEARANCE = CollisionChecker(ARM, TOOL)


def posture(p_WB):
    q = find_posture(ARM, Pose(np.eye(3), np.array(p_WB)), TOOL.X_TB, [ARM.home])
    assert q is not None
    return q


def among(*boxes):
    fragments = []
    for size, at in boxes:
        shape = trimesh.creation.box(size)
        fragments.append(Fragment(Mesh(shape.vertices, shape.faces), Pose(np.eye(3), at)))
    return Surroundings(CLEARANCE, Heights(map(stamp_of, fragments)))


def is_free(around, way, q_from, q_to):
    at = q_from
    for path in way:
        assert path.waypoints[0] == pytest.approx(at)
        fine = path.curve(np.linspace(0.0, path.length, 200))
        assert CLEARANCE.free(fine, around.heights, 0.5 * MARGIN)
        at = path.waypoints[-1]
    assert np.cos(at - q_to) == pytest.approx(1.0)  # give or take whole turns
    return True


def test_where_nothing_is_in_the_way_all_joints_go_straight():
    around = among()
    way = find_way(ARM, around, ARM.home, posture([0.05, 0.1, 0.05]))
    assert len(way) == 1
    assert is_free(around, way, ARM.home, posture([0.05, 0.1, 0.05]))


WALL = ((0.3, 0.03, 0.14), [0.0, 0.0, 0.07])
LEFT, RIGHT = [0.0, -0.15, 0.05], [0.0, 0.15, 0.05]


def test_a_wall_is_passed_over():
    around = among(WALL)
    q_from, q_to = posture(LEFT), posture(RIGHT)
    assert not around.free(straight(q_from, q_to))
    way = find_way(ARM, around, q_from, q_to)
    assert len(way) > 1
    assert is_free(around, way, q_from, q_to)


def test_two_trees_find_a_way_by_themselves_and_always_the_same():
    around = among(WALL)
    q_from, q_to = posture(LEFT), posture(RIGHT)
    grown = _grown(ARM, around, q_from, q_to)
    assert grown is not None
    assert is_free(around, [straight(a, b) for a, b in pairwise(grown)], q_from, q_to)
    assert np.array_equal(grown, _grown(ARM, around, q_from, q_to))


def test_there_is_no_way_to_a_posture_that_touches():
    around = among(WALL)
    assert find_way(ARM, around, ARM.home, posture([0.0, 0.0, 0.05])) is None


def test_nothing_to_do_is_no_path():
    assert find_way(ARM, among(), ARM.home, ARM.home) == ()
