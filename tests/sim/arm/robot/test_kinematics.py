import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.dynamics import Load, gravity_torques, inverse_dynamics
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_pose, flange_poses, inverse_kinematics, jacobian, solutions

TABLE = Path(__file__).parents[3] / "data" / "kinova_gen3_reference.npz"
"""Made by benchmarks/arm_reference.py from Kinova's description, by Pinocchio."""


@pytest.fixture(scope="module")
def table():
    return dict(np.load(TABLE, allow_pickle=False))


def test_the_flange_is_where_kinovas_description_puts_it(table):
    X = flange_poses(gen3(), table["postures"])
    assert len(X) == 1000
    turned = Rotation.from_matrix(X[:, :3, :3]).inv() * Rotation.from_quat(table["flange"][:, 3:], scalar_first=True)
    assert np.linalg.norm(X[:, :3, 3] - table["flange"][:, :3], axis=1).max() < 1e-9
    assert turned.magnitude().max() < 1e-9


def test_motors_hold_the_arm_with_the_torques_of_the_description(table):
    assert np.abs(gravity_torques(gen3(), table["postures"]) - table["gravity"]).max() < 1e-9


def test_motors_move_the_arm_with_the_torques_of_the_description(table):
    q, qd, qdd = table["postures"][:200], table["velocities"], table["accelerations"]
    assert np.abs(inverse_dynamics(gen3(), q, qd, qdd) - table["torques"]).max() < 1e-9


def test_the_jacobian_is_that_of_the_description(table):
    X = flange_poses(gen3(), table["postures"][:50])
    ours = [jacobian(gen3(), q, p) for q, p in zip(table["postures"], X[:, :3, 3], strict=False)]
    assert np.abs(ours - table["jacobian"]).max() < 1e-9


def test_masses_centres_and_inertias_are_those_of_the_description(table):
    links = gen3().links
    assert [link.mass for link in links] == table["masses"].tolist()
    assert np.array_equal([link.p_LC for link in links], table["centres"])
    assert np.array_equal([link.inertia for link in links], table["inertias"])


def test_a_pose_of_the_flange_is_reached_within_the_limits(rng, table):
    arm = gen3()
    low, high = np.array([[joint.low, joint.high] for joint in arm.joints]).T
    found = 0
    for q in table["postures"][:200]:
        X_AT = flange_pose(arm, q)
        answer = inverse_kinematics(arm, X_AT, arm.home)
        if answer is not None:
            found += 1
            again = flange_pose(arm, answer)
            assert np.abs(again.position - X_AT.position).max() < 1e-6
            assert Rotation.from_matrix(again.rotation.T @ X_AT.rotation).magnitude() < 1e-6
            assert ((low <= answer) & (answer <= high)).all()
    assert found > 190


LOAD = Load(0.8, np.array([0.02, -0.03, 0.12]), np.diag([2e-3, 3e-3, 1e-3]))


def test_a_load_adds_the_torques_of_its_weight_at_its_centre_of_mass(table):
    arm = gen3()
    for q in table["postures"][:20]:
        added = gravity_torques(arm, q, [LOAD])[0] - gravity_torques(arm, q)[0]
        J = jacobian(arm, q, flange_pose(arm, q).apply(LOAD.p_TC))
        assert added == pytest.approx(J[:3].T @ [0.0, 0.0, 9.81 * LOAD.mass], abs=1e-9)


def test_the_power_that_motors_add_for_a_load_is_the_rate_of_its_energy(table):
    arm, step = gen3(), 1e-5
    q, qd, qdd = table["postures"][:20], table["velocities"][:20], table["accelerations"][:20]

    def energy(q, qd):
        X = flange_poses(arm, q)
        found = []
        for posture, rates, R, p in zip(q, qd, X[:, :3, :3], X[:, :3, 3], strict=True):
            v, w = np.split(jacobian(arm, posture, R @ LOAD.p_TC + p) @ rates, 2)
            height = (R @ LOAD.p_TC + p)[2]
            found.append(LOAD.mass * (v @ v / 2 + 9.81 * height) + w @ R @ LOAD.inertia @ R.T @ w / 2)
        return np.array(found)

    later, sooner = (energy(q + s * qd + s * s / 2 * qdd, qd + s * qdd) for s in (step, -step))
    added = inverse_dynamics(arm, q, qd, qdd, [LOAD]) - inverse_dynamics(arm, q, qd, qdd)
    assert (added * qd).sum(axis=1) == pytest.approx((later - sooner) / (2 * step), abs=1e-5)


def test_a_pose_out_of_reach_or_beyond_a_limit_has_no_solution(table):
    arm = gen3()
    low, high = np.array([[joint.low, joint.high] for joint in arm.joints]).T
    far = Pose(np.eye(3), np.array([1.3, 0.0, 0.3]))
    behind_itself = Pose(np.eye(3), np.array([0.0, 0.0, 0.1]))
    for q in table["postures"][:50]:
        assert inverse_kinematics(arm, far, q) is None
        assert inverse_kinematics(arm, behind_itself, q) is None
    stiff = dataclasses.replace(arm, joints=tuple(dataclasses.replace(j, low=-0.3, high=0.3) for j in arm.joints))
    assert inverse_kinematics(stiff, flange_pose(arm, arm.home), arm.home) is None
    assert ((low <= arm.home) & (arm.home <= high)).all()


def test_a_posture_is_found_near_the_seed(table, rng):
    arm = gen3()
    for q in table["postures"][:50]:
        begin = np.clip(q, -1.9, 1.9) + rng.normal(0.0, 0.02, 7)
        found = inverse_kinematics(arm, flange_pose(arm, np.clip(q, -1.9, 1.9)), begin)
        assert found is not None
        assert np.abs(found - begin).max() < 0.3


def test_a_joint_without_limits_keeps_its_whole_turns():
    arm = gen3()
    turns = 2.0 * np.pi * np.array([1, 0, -1, 0, 2, 0, 0])
    X_AT = flange_pose(arm, arm.home)
    found = inverse_kinematics(arm, X_AT, arm.home + turns + 0.01)
    assert found is not None
    assert np.abs(found - arm.home - turns).max() < 0.1


def test_the_same_search_finds_the_same_posture_bit_by_bit(table):
    arm = gen3()
    targets = [flange_pose(arm, q) for q in table["postures"][:50]]
    answers = [inverse_kinematics(arm, X, arm.home) for X in targets]
    again = [inverse_kinematics(gen3(), X, arm.home) for X in reversed(targets)][::-1]
    for a, b in zip(answers, again, strict=True):
        assert (a is None and b is None) or np.array_equal(a, b)


def test_solutions_are_different_postures_with_one_pose(table):
    arm = gen3()
    X_AT = flange_pose(arm, arm.home)
    found = solutions(arm, X_AT, [arm.home, arm.home, *table["postures"][:20]])
    assert np.array_equal(found[0], arm.home)
    assert len(found) > 3
    for k, q in enumerate(found):
        assert np.abs(flange_pose(arm, q).position - X_AT.position).max() < 1e-6
        assert all(np.abs(q - other).max() > 1e-3 for other in found[:k])


def test_postures_of_another_arm_are_refused():
    with pytest.raises(ValueError, match="7 joints"):
        flange_poses(gen3(), np.zeros((4, 6)))
