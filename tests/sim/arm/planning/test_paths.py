import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.paths import CHECK_STEP, Path, find_line, find_posture, nearest_turns, straight
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_poses
from cutgrammar_sim.arm.robot.tool import knife

ARM, TOOL = gen3(), knife(Settings())


def edge(q):
    """(t, 4, 4) X_WB."""
    X_AB = flange_poses(ARM, q) @ np.block([[TOOL.X_TB.rotation, TOOL.X_TB.position[:, None]], [np.eye(4)[3:]]])
    X_AB[:, :3, 3] = X_WA.apply(X_AB[:, :3, 3])
    return X_AB


def test_the_blade_stays_on_its_line_between_the_waypoints_too(rng):
    followed = 0
    for _ in range(20):
        yaw, lean = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-20.0, 20.0))
        X_WB = Pose(Rotation.from_euler("ZY", [yaw, lean]).as_matrix(), np.append(rng.uniform(-0.1, 0.1, 2), 0.0))
        q = find_posture(ARM, X_WB, TOOL.X_TB)
        assert q is not None
        up = X_WB.rotation[:, 2]
        line = find_line(ARM, X_WB, TOOL.X_TB, q, 0.07 * up)
        if line is None:
            continue
        followed += 1
        assert line.length == pytest.approx(0.07)
        s = np.linspace(0.0, 0.07, 123)
        X = edge(line.curve(s))
        assert np.abs(X[:, :3, 3] - (X_WB.position + s[:, None] * up)).max() < 2e-5
        assert np.abs(X[:, :3, :3] - X_WB.rotation).max() < 5e-5
    assert followed >= 18


def test_a_pose_out_of_reach_has_no_posture_and_no_line():
    assert find_posture(ARM, Pose(np.eye(3), [0.9, 0.0, 0.0]), TOOL.X_TB) is None
    X_WB = Pose(np.eye(3), [0.2, 0.0, 0.1])
    q = find_posture(ARM, X_WB, TOOL.X_TB)
    assert find_line(ARM, X_WB, TOOL.X_TB, q, np.array([0.6, 0.0, 0.0])) is None


def test_a_path_is_sampled_in_small_steps_and_can_be_reversed_and_divided(rng):
    path = straight(ARM.home, ARM.home + rng.uniform(-1.0, 1.0, 7))
    steps = path.sampled()
    assert np.abs(np.diff(steps, axis=0)).max() <= CHECK_STEP
    assert steps[0] == pytest.approx(path.waypoints[0])
    assert steps[-1] == pytest.approx(path.waypoints[1])
    assert path.reversed().sampled() == pytest.approx(steps[::-1])
    curved = Path(np.linspace(0.0, 0.08, 9), np.cumsum(rng.normal(size=(9, 7)), axis=0) * 0.05, metres=True)
    part = curved.part(0.01, 0.05)
    assert part.length == pytest.approx(0.04)
    assert part.metres
    assert part.curve([0.0, 0.04]) == pytest.approx(curved.curve([0.01, 0.05]))


def test_joints_without_limits_take_the_nearest_turn_and_the_others_none():
    to = np.array(ARM.home)
    turns = nearest_turns(ARM, ARM.home + 7.0, to)
    endless = np.isinf([joint.low for joint in ARM.joints])
    assert turns == pytest.approx(np.where(endless, 2.0 * np.pi, 0.0))
