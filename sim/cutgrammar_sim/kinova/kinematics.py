"""Where an arm's links are, how they move, what its motors bear, and which postures reach a pose.

All over arrays of postures; A is the arm's base, whose z points up, L a link, T the flange. A pose that the flange is
to have is reached by `chain.reach_for`, within the joints' limits; a joint that turns without end takes the turn
nearest to where the search began.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.kinova.chain import chain_of, jacobian_at, place_all, reach_for
from cutgrammar_sim.kinova.description import Arm

GRAVITY = 9.81
"""Down along z of A [m/s2]."""


@dataclass(frozen=True, eq=False)
class Load:
    """Something rigid that is fixed to the flange: a tool, or what it carries.

    Attributes:
        mass: [kg].
        p_TC: (3,) centre of mass in T [m].
        inertia: (3, 3) about the centre of mass, axes of T [kg m2].
    """

    mass: float
    p_TC: Floats
    inertia: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_TC", frozen_floats(self.p_TC, (3,), "p_TC"))
        object.__setattr__(self, "inertia", frozen_floats(self.inertia, (3, 3), "inertia"))


def link_poses(arm: Arm, q: Floats) -> Floats:
    """(t, n + 1, 4, 4) X_AL of all links, for the postures q (t, n) [rad]."""
    poses: Floats = place_all(chain_of(arm), _postures(arm, q))
    return poses


def flange_poses(arm: Arm, q: Floats) -> Floats:
    """(t, 4, 4) X_AT, for the postures q (t, n) [rad]."""
    X_LT = np.eye(4)
    X_LT[:3, :3], X_LT[:3, 3] = arm.X_LT.rotation, arm.X_LT.position
    return np.asarray(link_poses(arm, q)[:, -1] @ X_LT)


def flange_pose(arm: Arm, q: Floats) -> Pose:
    """X_AT, for the posture q (n,) [rad]."""
    X_AT = flange_poses(arm, q)[0]
    return Pose(X_AT[:3, :3], X_AT[:3, 3])


def jacobian(arm: Arm, q: Floats, p_A: Floats) -> Floats:
    """How a point of the last link, and of all that is fixed to it, moves.

    Args:
        q: (n,) posture [rad].
        p_A: (3,) where the point is in A [m].

    Returns:
        (6, n): what the joints' velocities are multiplied with for the point's velocity and, below it, the link's
        angular velocity, axes of A. Its transpose gives the joints' torques for a force and a torque at the point.
    """
    J: Floats = jacobian_at(chain_of(arm), _postures(arm, q)[0], np.array(p_A, dtype=np.float64))
    return J


def gravity_torques(arm: Arm, q: Floats, loads: Iterable[Load] = ()) -> Floats:
    """(t, n) torques with which the motors hold the arm and its loads still, for the postures q (t, n) [rad, N m]."""
    still = np.zeros_like(_postures(arm, q))
    return inverse_dynamics(arm, q, still, still, loads)


def inverse_dynamics(arm: Arm, q: Floats, qd: Floats, qdd: Floats, loads: Iterable[Load] = ()) -> Floats:
    """Torques of the motors for a motion against gravity, by the recursive Newton-Euler equations.

    Args:
        q, qd, qdd: (t, n) angles, velocities and accelerations [rad, rad/s, rad/s2].
        loads: fixed to the flange.

    Returns:
        (t, n) [N m].
    """
    q, qd, qdd = (_postures(arm, array) for array in (q, qd, qdd))
    poses = link_poses(arm, q)
    R, p = poses[..., :3, :3], poses[..., :3, 3]
    axes = np.einsum("tiab,ib->tia", R[:, 1:], chain_of(arm).axes)
    t, n = q.shape
    bodies = [[(link.mass, link.p_LC, link.inertia)] for link in arm.links]
    turn = arm.X_LT.rotation
    bodies[-1] += [(load.mass, arm.X_LT.apply(load.p_TC), turn @ load.inertia @ turn.T) for load in loads]
    # outward: velocities and accelerations of every link's origin, which falls upwards in place of gravity
    w, dw, a = np.zeros((t, 3)), np.zeros((t, 3)), np.tile([0.0, 0.0, GRAVITY], (t, 1))
    forces, torques = np.zeros((t, n, 3)), np.zeros((t, n, 3))  # that each link needs, about its origin
    for i in range(n):
        r = p[:, i + 1] - p[:, i]
        a = a + np.cross(dw, r) + np.cross(w, np.cross(w, r))
        spin = axes[:, i] * qd[:, i, None]
        dw = dw + axes[:, i] * qdd[:, i, None] + np.cross(w, spin)
        w = w + spin
        for mass, p_LC, inertia in bodies[i + 1]:
            c = R[:, i + 1] @ p_LC
            force = mass * (a + np.cross(dw, c) + np.cross(w, np.cross(w, c)))
            inertia_A = R[:, i + 1] @ inertia @ np.swapaxes(R[:, i + 1], 1, 2)
            forces[:, i] += force
            torques[:, i] += np.cross(c, force)
            torques[:, i] += np.einsum("tab,tb->ta", inertia_A, dw)
            torques[:, i] += np.cross(w, np.einsum("tab,tb->ta", inertia_A, w))
    # inward: what each joint hands on
    tau = np.empty((t, n))
    force, torque = np.zeros((t, 3)), np.zeros((t, 3))
    for i in range(n - 1, -1, -1):
        if i + 1 < n:
            torque = torque + np.cross(p[:, i + 2] - p[:, i + 1], force)
        force, torque = force + forces[:, i], torque + torques[:, i]
        tau[:, i] = np.einsum("ta,ta->t", axes[:, i], torque)
    return tau


def inverse_kinematics(arm: Arm, X_AT: Pose, seed: Floats) -> Floats | None:
    """A posture with the flange at X_AT, to 1e-7 m and rad, within the limits, found from `seed` (n,); or None."""
    q = np.array(seed, dtype=np.float64)
    return q if reach_for(chain_of(arm), np.array(X_AT.rotation), np.array(X_AT.position), q) else None


def solutions(arm: Arm, X_AT: Pose, seeds: Iterable[Floats]) -> list[Floats]:
    """The postures found from each of `seeds`, in their order, without those within 1e-3 rad of an earlier one."""
    found: list[Floats] = []
    for seed in seeds:
        q = inverse_kinematics(arm, X_AT, seed)
        if q is not None and all(np.abs(q - other).max() > 1e-3 for other in found):
            found.append(q)
    return found


def _postures(arm: Arm, q: Floats) -> Floats:
    """(t, n) from (t, n) or (n,): a copy, for compiled code is compiled once for each layout and for read-only arrays."""
    q = np.array(np.atleast_2d(q), dtype=np.float64, order="C")
    if q.ndim != 2 or q.shape[1] != len(arm.joints):
        raise ValueError(f"postures of shape {q.shape} for an arm of {len(arm.joints)} joints")
    return q
