import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.dynamics import gravity_torques
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_pose, flange_poses, link_poses
from cutgrammar_sim.arm.robot.tool import knife

EXTENTS = {
    "base": ((-0.0461, -0.046, 0.0), (0.0464, 0.0462, 0.1708)),
    "shoulder": ((-0.0464, -0.0487, -0.1744), (0.0464, 0.0461, -0.0024)),
    "half arm 1": ((-0.046, -0.2248, -0.0554), (0.046, 0.046, 0.0396)),
    "half arm 2": ((-0.046, -0.049, -0.2564), (0.046, 0.046, -0.0024)),
    "forearm": ((-0.046, -0.2209, -0.0559), (0.046, 0.046, 0.0286)),
    "wrist 1": ((-0.035, -0.053, -0.141), (0.035, 0.035, -0.0025)),
    "wrist 2": ((-0.035, -0.1184, -0.0533), (0.035, 0.0351, 0.0348)),
    "bracelet": ((-0.0455, -0.0747, -0.0644), (0.0455, 0.0375, -0.0025)),
}
"""Lowest and highest coordinates of Kinova's collision meshes in the links' frames [m]."""


def frames_of(arm, q):
    """(4, 4) X_AL of every link and at last X_AT, by plain products of matrices."""
    frames = [np.eye(4)]
    for joint, angle in zip(arm.joints, q, strict=True):
        turned = Pose(Rotation.from_rotvec(angle * joint.axis).as_matrix(), np.zeros(3))
        frames.append(frames[-1] @ matrix_of(joint.X_PJ @ turned))
    return [*frames, frames[-1] @ matrix_of(arm.X_LT)]


def matrix_of(X):
    return np.block([[X.rotation, X.position[:, None]], [np.zeros(3), 1.0]])


def potential_energy(arm, q):
    """Potential energy of a posture [J]."""
    frames = frames_of(arm, q)
    heights = [(X[:3, :3] @ link.p_LC + X[:3, 3])[2] for X, link in zip(frames, arm.links, strict=False)]
    return sum(9.81 * link.mass * height for link, height in zip(arm.links, heights, strict=True))


def test_links_and_flange_are_where_plain_products_of_matrices_put_them(rng):
    arm = gen3()
    postures = rng.uniform(-3.0, 3.0, (50, 7))
    plain = np.array([frames_of(arm, q) for q in postures])
    assert np.abs(link_poses(arm, postures) - plain[:, :-1]).max() < 1e-12
    assert np.abs(flange_poses(arm, postures) - plain[:, -1]).max() < 1e-12


def test_torques_against_gravity_are_the_slope_of_the_potential_energy(rng):
    arm, step = gen3(), 1e-5
    postures = rng.uniform(-3.0, 3.0, (20, 7))
    slopes = [
        [(potential_energy(arm, q + d) - potential_energy(arm, q - d)) / (2 * step) for d in step * np.eye(7)]
        for q in postures
    ]
    assert np.abs(gravity_torques(arm, postures) - slopes).max() < 1e-6


def test_capsules_reach_as_far_as_the_links_do():
    for link in gen3().links:
        low = np.min([capsule.ends.min(axis=0) - capsule.radius for capsule in link.capsules], axis=0)
        high = np.max([capsule.ends.max(axis=0) + capsule.radius for capsule in link.capsules], axis=0)
        assert (low <= EXTENTS[link.name][0]).all()
        assert (high >= EXTENTS[link.name][1]).all()


def test_at_home_the_knife_hangs_over_the_board():
    X_WB = X_WA @ flange_pose(gen3(), gen3().home) @ knife(Settings()).X_TB
    assert X_WB.rotation[2, 2] > 0.999
    assert X_WB.position[2] > 0.25
    assert np.abs(X_WB.position[:2]).max() < 0.15


@pytest.mark.parametrize("camera", [(0.5, 0.0, 0.75), (-0.35, 0.6, 0.7)])
def test_at_home_the_arm_does_not_hide_the_board_from_a_camera(camera):
    arm, tool = gen3(), knife(Settings())
    X_WL = [(X[:3, :3], X_WA.apply(X[:3, 3])) for X in link_poses(arm, arm.home)[0]]
    X_WT = X_WA @ flange_pose(arm, arm.home)
    covers = [(c.ends @ R.T + p, c.radius) for link, (R, p) in zip(arm.links, X_WL, strict=True) for c in link.capsules]
    covers += [(X_WT.apply(c.ends), c.radius) for c in (tool.handle, tool.gripper_in)]
    y, z = tool.length / 2, tool.height
    edge = (X_WT @ tool.X_TB).apply(np.array([[0, -y, 0], [0, y, 0], [0, -y, z], [0, y, z]]))
    covers += [(edge[:2], 0.0), (edge[2:], 0.0)]
    places = np.stack(np.meshgrid(*[np.linspace(-0.2, 0.2, 5)] * 2, [0.0, 0.06]), axis=-1).reshape(-1, 3)
    sight = places + np.linspace(0.0, 1.0, 100)[:, None, None] * (np.array(camera) - places)
    for ends, radius in covers:
        along = ends[0] + np.linspace(0.0, 1.0, 20)[:, None] * (ends[1] - ends[0])
        assert np.linalg.norm(sight.reshape(-1, 1, 3) - along, axis=-1).min() > radius + 0.02
