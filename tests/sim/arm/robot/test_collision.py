import numpy as np
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.paths import find_posture
from cutgrammar_sim.arm.robot.collision import FIRST_MOVING, Body, CollisionChecker, collision_hull
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import link_poses
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())
CHECKER = CollisionChecker(ARM, TOOL)


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


def distance(a, b):
    """Distance of two segments, from many points of each."""
    s = np.linspace(0.0, 1.0, 25)[:, None]
    p, r = a[0] + s * (a[1] - a[0]), b[0] + s * (b[1] - b[0])
    return np.linalg.norm(p[:, None] - r, axis=2).min()


def test_the_arm_at_home_touches_nothing():
    for gripper_out in (False, True):
        assert CHECKER.scene([], 0.01, gripper_out).is_free(ARM.home)


def test_in_a_free_posture_all_moving_links_keep_the_margin_from_the_board(rng):
    margin, free = 0.004, 0
    scene = CHECKER.scene([], margin)
    for q in rng.uniform(-2.0, 2.0, (300, 1, 7)):
        if scene.is_free(q):
            free += 1
            lowest = min(ends[:, 2].min() - radius for link, ends, radius in segments(q) if link >= FIRST_MOVING)
            assert lowest >= margin - 1e-9
    assert 30 < free < 300


def test_postures_in_which_distant_links_touch_are_not_free(rng):
    scene, seen = CHECKER.scene([], -1.0), 0
    high = np.array([2.0, 2.2, 2.0, 2.5, 3.0, 2.0, 3.0])
    for q in high * rng.uniform(0.9, 1.0, (150, 1, 7)) * rng.choice([-1.0, 1.0], (150, 1, 7)):
        parts = segments(q)
        touching = any(
            distance(a, b) < ra + rb - 3e-3
            for m, (i, a, ra) in enumerate(parts)
            for j, b, rb in parts[m + 1 :]
            if j - i > 1 and not (j == len(ARM.links) and i >= len(ARM.links) - 2)
        )
        if touching:
            seen += 1
            assert not scene.is_free(q)
    assert seen > 5


def test_the_extended_gripper_reaches_lower_than_the_blade():
    low = find_posture(ARM, Pose(np.eye(3), np.array([0, 0, 0.045])), TOOL.X_TB)
    assert CHECKER.scene([], 0.002).is_free(low)
    assert not CHECKER.scene([], 0.002, gripper_out=True).is_free(low)


def test_a_held_fragment_may_be_clear_of_the_knife_or_touch_it():
    shape = trimesh.creation.box((0.03, 0.03, 0.03))
    cube = Mesh(shape.vertices, shape.faces)
    X_GF = Pose(np.eye(3), [0.0, 0.0, -0.015])
    assert CHECKER.is_clear_of_knife(Body(cube, TOOL.X_TG @ X_GF))
    assert not CHECKER.is_clear_of_knife(Body(cube, TOOL.X_TB @ X_GF))


def test_the_hull_of_a_mesh_has_its_volume_and_corners(lump):
    hull = collision_hull(lump)
    solid = trimesh.Trimesh(lump.vertices, lump.faces).convex_hull
    assert hull.num_points == len(solid.vertices)
    assert np.isclose(hull.computeVolume(), solid.volume, rtol=1e-6)
