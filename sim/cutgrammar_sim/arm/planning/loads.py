"""Torques of the arm's motors and the wrench on its flange, from its motion and the forces on the blade.

All functions take arrays of samples, planned or logged. A is the arm's base, T the flange, W the world, whose axes are
those of A.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.canonical import canonical_frame, covariance
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import X_WA, Arm
from cutgrammar_sim.arm.robot.dynamics import GRAVITY, Load
from cutgrammar_sim.arm.robot.kinematics import flange_poses, jacobian


@dataclass(frozen=True, eq=False)
class Pushes:
    """Forces on the blade.

    Attributes:
        forces_W: (t, 3) [N].
        p_WP: (t, 3) point at which each acts [m].
    """

    forces_W: Floats
    p_WP: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "forces_W", frozen_floats(self.forces_W, (None, 3), "forces_W"))
        object.__setattr__(self, "p_WP", frozen_floats(self.p_WP, self.forces_W.shape, "p_WP"))


def load_of_fragment(mesh: Mesh, X_TF: Pose, density: float) -> Load:
    """A fragment at X_TF that the gripper holds, as a load on the flange; density in kg/m3."""
    mass = density * mesh.volume
    X_FC = canonical_frame(mesh)
    spread = np.diag(X_FC.rotation.T @ covariance(mesh) @ X_FC.rotation)
    axes_T = X_TF.rotation @ X_FC.rotation
    inertia = axes_T @ np.diag(mass * (spread.sum() - spread)) @ axes_T.T
    return Load(mass, X_TF.apply(mesh.centroid), inertia)


def pushed_torques(arm: Arm, q: Floats, pushes: Pushes) -> Floats:
    """(t, n) torques with which the motors balance the forces on the blade, in the postures q (t, n) [rad, N m]."""
    torques = np.zeros_like(q)
    p_AP = pushes.p_WP - X_WA.position
    for k in np.flatnonzero(np.abs(pushes.forces_W).max(axis=1) > 0.0):
        torques[k] = -pushes.forces_W[k] @ jacobian(arm, q[k], p_AP[k])[:3]
    return torques


def flange_wrenches(arm: Arm, times: Floats, q: Floats, loads: Sequence[Load], pushes: Pushes | None) -> Floats:
    """Wrench of the tool and other loads on the flange: their weight, their inertia and the forces on the blade.

    Args:
        times: (t,) [s], ascending.
        q: (t, n) postures at these times [rad].
        loads: bodies fixed to the flange.
        pushes: forces on the blade.

    Returns:
        (t, 6) force and torque on the flange, about its origin, axes of W [N, N m].
    """
    X_AT = flange_poses(arm, q)
    R, p = X_AT[:, :3, :3], X_AT[:, :3, 3]
    w = _angular_velocities(times, R)
    dw = np.gradient(w, times, axis=0)
    wrench = np.zeros((len(times), 6))
    for load in loads:
        lever = R @ load.p_TC
        rate = np.gradient(np.gradient(p + lever, times, axis=0), times, axis=0)
        force = -load.mass * (rate + np.array([0.0, 0.0, GRAVITY]))
        inertia = R @ load.inertia @ np.swapaxes(R, 1, 2)
        spin = np.einsum("tab,tb->ta", inertia, w)
        turn = np.einsum("tab,tb->ta", inertia, dw) + np.cross(w, spin)
        wrench[:, :3] += force
        wrench[:, 3:] += np.cross(lever, force) - turn
    if pushes is not None:
        wrench[:, :3] += pushes.forces_W
        wrench[:, 3:] += np.cross(pushes.p_WP - X_WA.position - p, pushes.forces_W)
    return wrench


def _angular_velocities(times: Floats, R: Floats) -> Floats:
    """(t, 3) angular velocities of the rotations R (t, 3, 3) at `times` [rad/s]."""
    rate = np.gradient(R, times, axis=0) @ np.swapaxes(R, 1, 2)
    return (
        np.stack([rate[:, 2, 1] - rate[:, 1, 2], rate[:, 0, 2] - rate[:, 2, 0], rate[:, 1, 0] - rate[:, 0, 1]], 1) / 2
    )
