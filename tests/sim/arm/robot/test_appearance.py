import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.appearance import links_of, poses_of
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_pose
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())
LINKS = {link.name: (i, link.mesh) for i, link in enumerate(links_of(ARM, TOOL))}


def test_every_part_is_closed_and_faces_outward():
    for index, mesh in LINKS.values():
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
        assert solid.is_watertight, index
        assert solid.is_winding_consistent
        assert solid.volume > 0.0
    capsule = ARM.links[1].capsules[0]
    length = np.linalg.norm(capsule.ends[1] - capsule.ends[0])
    volume = np.pi * capsule.radius**2 * (length + 4 / 3 * capsule.radius)
    assert LINKS["shoulder"][1].volume == pytest.approx(volume, rel=0.05)


def test_the_blade_is_where_the_flange_says_and_its_edge_is_at_its_origin():
    poses = poses_of(ARM, TOOL, ARM.home[None], np.array([False]))
    index, mesh = LINKS["blade"]
    X_WB = X_WA @ flange_pose(ARM, ARM.home) @ TOOL.X_TB
    assert poses[0, index] == pytest.approx(X_WB.to_vector())
    lowest = mesh.vertices[mesh.vertices[:, 2] < 1e-9]
    assert np.ptp(lowest[:, 1]) == pytest.approx(TOOL.length)
    assert lowest[:, [0, 2]] == pytest.approx(0.0)


def test_the_gripper_extends_as_far_as_its_capsule_and_is_hidden_when_retracted():
    poses = poses_of(ARM, TOOL, np.tile(ARM.home, (2, 1)), np.array([False, True]))
    index, mesh = LINKS["gripper tube 3"]
    tips = [Pose.from_vector(poses[k, index]).apply(mesh.vertices) for k in range(2)]
    X_TW = (X_WA @ flange_pose(ARM, ARM.home)).inverse()
    drawn_in, come_out = (X_TW.apply(tip)[:, 2].max() for tip in tips)
    radius = np.ptp(mesh.vertices[:, 0]) / 2
    assert come_out == pytest.approx(TOOL.gripper_out.ends[1, 2] + radius, abs=1e-4)
    assert drawn_in < TOOL.gripper_in.ends[1, 2] + TOOL.gripper_in.radius
