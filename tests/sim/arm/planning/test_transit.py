from itertools import pairwise

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.paths import find_posture, straight
from cutgrammar_sim.arm.planning.scene import MARGIN, PlanningScene
from cutgrammar_sim.arm.planning.transit import _rrt_connect, find_transit
from cutgrammar_sim.arm.robot.collision import CollisionChecker
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())
CHECKER = CollisionChecker(ARM, TOOL)


def posture(p_WB):
    q = find_posture(ARM, Pose(np.eye(3), np.array(p_WB)), TOOL.X_TB)
    assert q is not None
    return q


def among(*boxes):
    fragments = []
    for size, at in boxes:
        shape = trimesh.creation.box(size)
        fragments.append(Fragment(Mesh(shape.vertices, shape.faces), Pose(np.eye(3), at)))
    return PlanningScene(CHECKER, tuple(fragments))


def is_free(scene, paths, q_from, q_to):
    at = q_from
    for path in paths:
        assert path.waypoints[0] == pytest.approx(at)
        fine = path.curve(np.linspace(0.0, path.length, 200))
        assert scene.is_free(fine, 0.5 * MARGIN)
        at = path.waypoints[-1]
    assert np.cos(at - q_to) == pytest.approx(1.0)  # give or take whole turns
    return True


def test_all_joints_move_straight_when_nothing_is_in_the_way():
    scene = among()
    paths = find_transit(ARM, scene, ARM.home, posture([0.05, 0.1, 0.05]))
    assert len(paths) == 1
    assert is_free(scene, paths, ARM.home, posture([0.05, 0.1, 0.05]))


WALL = ((0.3, 0.03, 0.14), [0.0, 0.0, 0.07])
LEFT, RIGHT = [0.0, -0.15, 0.05], [0.0, 0.15, 0.05]


def test_a_wall_is_passed_over():
    scene = among(WALL)
    q_from, q_to = posture(LEFT), posture(RIGHT)
    assert not scene.is_path_free(straight(q_from, q_to))
    paths = find_transit(ARM, scene, q_from, q_to)
    assert len(paths) > 1
    assert is_free(scene, paths, q_from, q_to)


def test_rrt_connect_finds_a_path_and_always_the_same():
    scene = among(WALL)
    q_from, q_to = posture(LEFT), posture(RIGHT)
    postures = _rrt_connect(ARM, scene, q_from, q_to)
    assert postures is not None
    assert is_free(scene, [straight(a, b) for a, b in pairwise(postures)], q_from, q_to)
    assert np.array_equal(postures, _rrt_connect(ARM, scene, q_from, q_to))


def test_there_is_no_path_to_a_posture_that_touches():
    scene = among(WALL)
    assert find_transit(ARM, scene, ARM.home, posture([0.0, 0.0, 0.05])) is None


def test_an_arm_that_is_already_at_its_goal_needs_no_path():
    assert find_transit(ARM, among(), ARM.home, ARM.home) == ()
