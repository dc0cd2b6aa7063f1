import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.dynamics import gravity_torques
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_pose, flange_poses, link_poses
from cutgrammar_sim.arm.robot.tool import knife

REFERENCE = Path(__file__).parents[5] / "shared" / "reference" / "kinova_gen3" / "GEN3-7DOF-VISION_ARM_URDF_V12.urdf"
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
"""How far Kinova's collision meshes reach in the links' frames [m]."""


@pytest.fixture(scope="module")
def description():
    """Kinova's description, read plainly: joints as (4, 4) and limits, links as mass, centre and inertia."""
    if not REFERENCE.is_file():
        pytest.skip(
            f"no {REFERENCE}: it is GEN3-7DOF-VISION_ARM_URDF_V12.urdf of github.com/Kinovarobotics/ros_kortex,"
            " commit 6cd75d45, in kortex_description; put it there to compare with it"
        )
    tree = ElementTree.parse(REFERENCE).getroot()
    chain, at = [], "base_link"
    while at != "end_effector_link":
        joint = next(j for j in tree.iter("joint") if j.find("parent").get("link") == at)
        chain.append(joint)
        at = joint.find("child").get("link")
    links = [link for link in tree.iter("link") if link.find("inertial") is not None]
    return chain, links


def numbers(element, name):
    return np.array([float(number) for number in element.get(name).split()])


def placed(element):
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("xyz", numbers(element, "rpy")).as_matrix()
    X[:3, 3] = numbers(element, "xyz")
    return X


def inertia_of(link):
    inertial = link.find("inertial")
    six = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (float(six.get(name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    mass, centre = float(inertial.find("mass").get("value")), numbers(inertial.find("origin"), "xyz")
    return mass, centre, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def frames_of(chain, q):
    """(4, 4) of every link and at last the flange, for one posture."""
    frames, angles = [np.eye(4)], iter(q)
    for joint in chain:
        X = frames[-1] @ placed(joint.find("origin"))
        if joint.get("type") != "fixed":
            X[:3, :3] = X[:3, :3] @ Rotation.from_rotvec(next(angles) * numbers(joint.find("axis"), "xyz")).as_matrix()
        frames.append(X)
    return frames


def potential(chain, links, q):
    """Energy of a posture against gravity [J]."""
    frames = frames_of(chain, q)
    bodies = [inertia_of(link)[:2] for link in links]
    return sum(9.81 * mass * (X[:3, :3] @ c + X[:3, 3])[2] for X, (mass, c) in zip(frames, bodies, strict=False))


def test_kinovas_own_description_gives_the_same_flange_and_torques(description, rng):
    chain, links = description
    low, high = np.array([[max(j.low, -math.pi), min(j.high, math.pi)] for j in gen3().joints]).T
    postures = rng.uniform(low, high, (50, 7))
    theirs = np.array([frames_of(chain, q)[-1] for q in postures])
    assert np.abs(flange_poses(gen3(), postures) - theirs).max() < 1e-9
    step = 1e-5
    slopes = [
        [(potential(chain, links, q + d) - potential(chain, links, q - d)) / (2 * step) for d in step * np.eye(7)]
        for q in postures
    ]
    assert np.abs(gravity_torques(gen3(), postures) - slopes).max() < 1e-6


def test_kinovas_own_description_has_the_same_inertias_and_limits(description):
    chain, links = description
    for link, theirs in zip(gen3().links, links[:8], strict=True):
        mass, centre, inertia = inertia_of(theirs)
        assert link.mass == mass
        assert np.array_equal(link.p_LC, centre)
        assert np.array_equal(link.inertia, inertia)
    for joint, theirs in zip(gen3().joints, chain[:7], strict=True):
        limit = theirs.find("limit")
        assert joint.low == float(limit.get("lower", "-inf"))
        assert joint.high == float(limit.get("upper", "inf"))
        assert joint.velocity == float(limit.get("velocity"))
        assert joint.torque == float(limit.get("effort"))


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
def test_at_home_the_arm_hides_the_board_from_no_camera(camera):
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
