from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar_sim.kinova.gen3 import gen3
from cutgrammar_sim.kinova.kinematics import (
    flange_pose,
    flange_poses,
    gravity_torques,
    inverse_dynamics,
    inverse_kinematics,
    jacobian,
)

TABLE = Path(__file__).parents[2] / "data" / "kinova_gen3_reference.npz"
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
