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
from cutgrammar_sim.arm.robot.chain import chain_of, jacobian_at, place_all, reach_for
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.newton_euler import torques_for

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
    turn = arm.X_LT.rotation
    bodies = [(i, link.mass, link.p_LC, link.inertia) for i, link in enumerate(arm.links) if i > 0]
    bodies += [(len(arm.joints), load.mass, arm.X_LT.apply(load.p_TC), turn @ load.inertia @ turn.T) for load in loads]
    link, mass, p_LC, inertia = (np.array(column) for column in zip(*bodies, strict=True))
    tau: Floats = torques_for(link_poses(arm, q), chain_of(arm).axes, qd, qdd, link, mass, p_LC, inertia, GRAVITY)
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
    """(t, n) from (t, n) or (n,): a copy, for code is compiled once for each layout and for read-only arrays."""
    q = np.array(np.atleast_2d(q), dtype=np.float64, order="C")
    if q.ndim != 2 or q.shape[1] != len(arm.joints):
        raise ValueError(f"postures of shape {q.shape} for an arm of {len(arm.joints)} joints")
    return q
