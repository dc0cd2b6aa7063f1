import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.height_map import Heights, stamp_of, surface_points
from cutgrammar_sim.arm.planning.paths import find_posture
from cutgrammar_sim.arm.robot.collision import FIXED, CollisionChecker
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import link_poses
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())
CLEARANCE = CollisionChecker(ARM, TOOL)
DOWN = np.eye(3)


def posture(p_WB, rotation=DOWN):
    q = find_posture(ARM, Pose(rotation, np.array(p_WB)), TOOL.X_TB, [ARM.home])
    assert q is not None
    return q[None]


def box(size, at):
    shape = trimesh.creation.box(size)
    return Fragment(Mesh(shape.vertices, shape.faces), Pose(np.eye(3), at))


def segments(q, tool=True):
    """(link, ends in W, radius) of every capsule."""
    X = link_poses(ARM, q)[0]
    found = [
        (i, X_WA.apply(c.ends @ X[i, :3, :3].T + X[i, :3, 3]), c.radius)
        for i, link in enumerate(ARM.links)
        for c in link.capsules
    ]
    if tool:
        X_WT = X_WA @ Pose(X[-1, :3, :3], X[-1, :3, 3]) @ ARM.X_LT
        found += [(len(ARM.links), X_WT.apply(c.ends), c.radius) for c in (TOOL.handle, TOOL.gripper_in)]
    return found


def nearest(a, b):
    """Distance of two segments, from many points of each."""
    s = np.linspace(0.0, 1.0, 25)[:, None]
    p, r = a[0] + s * (a[1] - a[0]), b[0] + s * (b[1] - b[0])
    return np.linalg.norm(p[:, None] - r, axis=2).min()


def test_the_arm_at_home_touches_nothing():
    bare = Heights([])
    for out in (False, True):
        assert CLEARANCE.free(ARM.home[None], bare, 0.01, gripper_out=out)


def test_the_blade_is_held_against_what_stands_under_it_and_let_off_on_request():
    heights = Heights([stamp_of(box((0.04, 0.04, 0.05), [0.0, 0.0, 0.025]))])
    for height, free in ((0.07, True), (0.058, True), (0.053, False), (0.02, False)):
        assert CLEARANCE.free(posture([0, 0, height]), heights, 0.002) is free
    assert CLEARANCE.free(posture([0, 0, 0.02]), heights, 0.002, blade=False)
    assert CLEARANCE.free(posture([0.08, 0, 0.02]), heights, 0.002)
    assert not CLEARANCE.free(posture([0.08, 0, 0.001]), heights, 0.002)  # the board


def test_no_posture_that_counts_as_free_has_anything_but_fixed_links_near_the_board(rng):
    bare, margin = Heights([]), 0.004
    free = 0
    for q in rng.uniform(-2.0, 2.0, (300, 1, 7)):
        lowest = min(ends[:, 2].min() - radius for link, ends, radius in segments(q) if link >= FIXED)
        if CLEARANCE.free(q, bare, margin):
            free += 1
            assert lowest >= margin - 1e-9
    assert 30 < free < 300


def test_postures_in_which_far_links_touch_are_not_free(rng):
    bare, seen = Heights([]), 0
    high = np.array([2.0, 2.2, 2.0, 2.5, 3.0, 2.0, 3.0])
    for q in high * rng.uniform(0.9, 1.0, (150, 1, 7)) * rng.choice([-1.0, 1.0], (150, 1, 7)):
        parts = segments(q)
        touching = any(
            nearest(a, b) < ra + rb - 3e-3
            for m, (i, a, ra) in enumerate(parts)
            for j, b, rb in parts[m + 1 :]
            if j - i > 1 and not (j == len(ARM.links) and i >= len(ARM.links) - 2)
        )
        if touching:
            seen += 1
            assert not CLEARANCE.free(q, bare, -1.0)
    assert seen > 5


def test_the_gripper_come_out_reaches_lower_than_the_blade():
    bare = Heights([])
    low = posture([0, 0, 0.045])
    assert CLEARANCE.free(low, bare, 0.002)
    assert not CLEARANCE.free(low, bare, 0.002, gripper_out=True)


def test_what_is_held_is_held_against_others():
    carried = surface_points(box((0.03, 0.03, 0.03), [0, 0, 0]).mesh)
    held_T = (TOOL.X_TG @ Pose(np.eye(3), [0.0, 0.0, -0.015])).apply(carried)
    wall = Heights([stamp_of(box((0.02, 0.02, 0.09), [0.09, 0.0, 0.045]))])
    for height, free in ((0.06, False), (0.1, False), (0.15, True)):
        q = find_posture(ARM, Pose(DOWN, [0.072, 0.0, height]), TOOL.X_TG, [ARM.home])
        assert CLEARANCE.free(q[None], wall, 0.005, gripper_out=True, held=held_T) is free
    assert CLEARANCE.clear_of(held_T)
    assert not CLEARANCE.clear_of(held_T + TOOL.X_TB.position - TOOL.X_TG.position)


def test_one_posture_that_touches_spoils_a_path():
    bare = Heights([])
    down = posture([0, 0, -0.03])
    assert not CLEARANCE.free(np.concatenate([ARM.home[None], down, ARM.home[None]]), bare, 0.002)
    assert CLEARANCE.free(np.tile(ARM.home, (5, 1)), bare, 0.002)
    assert pytest.approx(CLEARANCE.places(ARM.home[None])[0, 0, :3, 3]) == X_WA.position
