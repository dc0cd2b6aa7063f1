import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.paths import find_posture, straight
from cutgrammar_sim.arm.planning.scene import CELL, PlanningScene
from cutgrammar_sim.arm.robot.collision import Body, CollisionChecker
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife
from simple_shapes import box_fragment as box

ARM, TOOL = gen3(), knife(Settings())
CHECKER = CollisionChecker(ARM, TOOL)


def posture(p_WE, X_TE=TOOL.X_TB):
    q = find_posture(ARM, Pose(np.eye(3), np.array(p_WE)), X_TE)
    assert q is not None
    return q


def test_the_blade_keeps_the_margin_from_what_is_under_it_unless_it_is_exempt():
    scene = PlanningScene(CHECKER, (box((0.04, 0.04, 0.05), [0.0, 0.0, 0.025]),))
    for height, free in ((0.07, True), (0.0525, True), (0.0515, False), (0.02, False)):
        assert scene.is_free(posture([0, 0, height]), 0.002) is free
    assert scene.is_free(posture([0, 0, 0.02]), 0.002, blade=False)
    assert scene.is_free(posture([0.08, 0, 0.02]), 0.002)
    assert not scene.is_free(posture([0.08, 0, 0.001]), 0.002)  # the board


def test_a_path_is_free_if_all_of_it_is():
    scene = PlanningScene(CHECKER, (box((0.04, 0.04, 0.08), [0.0, 0.0, 0.04]),))
    left, right = posture([0.0, -0.16, 0.05]), posture([0.0, 0.16, 0.05])
    assert scene.is_free(np.array([left, right]))
    assert not scene.is_path_free(straight(left, right))
    assert scene.is_path_free(straight(left, ARM.home))


def test_a_carried_fragment_keeps_the_margin_from_the_others():
    cube = box((0.03, 0.03, 0.03), [0, 0, 0]).mesh
    held = Body(cube, TOOL.X_TG @ Pose(np.eye(3), [0.0, 0.0, -0.015]))
    wall = PlanningScene(CHECKER, (box((0.02, 0.02, 0.09), [0.09, 0.0, 0.045]),)).holding(held)
    for height, free in ((0.06, False), (0.1, False), (0.15, True)):
        assert wall.is_free(posture([0.068, 0.0, height], TOOL.X_TG), 0.005) is free


def test_the_tallest_fragment_counts_and_an_empty_board_is_flat():
    low, high = box((0.03, 0.03, 0.02), [0.0, 0.0, 0.01]), box((0.03, 0.03, 0.07), [0.1, 0.0, 0.035])
    assert PlanningScene(CHECKER, (low, high)).tallest == 0.07
    assert PlanningScene(CHECKER, ()).tallest == 0.0
    assert PlanningScene(CHECKER, ()).footprint.shape == (0, 2)


def test_the_footprint_covers_all_fragments_and_little_more(lump, rng):
    fragments = tuple(
        Fragment(lump, Pose(Rotation.random(rng=rng).as_matrix(), [0.15 * k, 0.05 * k, 0.1])) for k in range(2)
    )
    cells = PlanningScene(CHECKER, fragments).footprint
    for fragment in fragments:
        corners = fragment.X_WF.apply(lump.vertices)[:, :2]
        inside = rng.dirichlet(np.ones(len(corners)), 500) @ corners
        assert np.abs(inside[:, None] - cells).max(axis=2).min(axis=1).max() <= CELL / 2 + 1e-12
    outlines = [ConvexHull(fragment.X_WF.apply(lump.vertices)[:, :2]).equations for fragment in fragments]
    beyond = np.min([(cells @ e[:, :2].T + e[:, 2]).max(axis=1) for e in outlines], axis=0)
    assert beyond.max() <= CELL
