"""The compiled core of the kinematics: frames, Jacobian and inverse kinematics of a serial chain, over plain arrays.

Inverse kinematics is damped least squares (Levenberg-Marquardt) with damping that follows the error, so that steps are
bold far from the target and Newton's near it. A joint at its limit that would go beyond is left out of the step.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats
from cutgrammar_sim.arm.robot.description import Arm

TOLERANCE = 1e-7
"""Error at which a posture counts as reaching its target [m, rad]."""
ITERATIONS = 60
"""After which a target counts as not reached from where the search began."""
PATIENCE = 12
"""Iterations without a better error after which the search gives up."""
DAMPING = 0.02
"""Times the squared error, which is added to the diagonal of J J^T."""
LARGEST_STEP = 0.7
"""Of any joint in one iteration [rad]."""


class Chain(NamedTuple):
    """An arm's geometry as compiled code reads it.

    Attributes:
        turns: (n, 3, 3, 3) R_PL of joint i at angle q is turns[i, 0] + cos(q) turns[i, 1] + sin(q) turns[i, 2].
        offsets: (n, 3) p_PJ [m].
        axes: (n, 3) axis of joint i in the frame of link i + 1, which is that in J.
        low, high: (n,) [rad].
        R_LT, p_LT: the flange in the last link.
        reach: no point of the flange is farther than this from the first joint [m].
    """

    turns: Floats
    offsets: Floats
    axes: Floats
    low: Floats
    high: Floats
    R_LT: Floats
    p_LT: Floats
    reach: float


@lru_cache(maxsize=16)
def chain_of(arm: Arm) -> Chain:
    """The geometry of `arm`."""
    turns = np.empty((len(arm.joints), 3, 3, 3))
    for i, joint in enumerate(arm.joints):
        along = np.outer(joint.axis, joint.axis)
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turns[i] = [joint.X_PJ.rotation @ part for part in (along, np.eye(3) - along, cross)]
    offsets = np.array([joint.X_PJ.position for joint in arm.joints])
    return Chain(
        turns,
        offsets,
        np.array([joint.axis for joint in arm.joints]),
        np.array([joint.low for joint in arm.joints]),
        np.array([joint.high for joint in arm.joints]),
        np.array(arm.X_LT.rotation),
        np.array(arm.X_LT.position),
        float(np.linalg.norm(offsets[1:], axis=1).sum() + np.linalg.norm(arm.X_LT.position)),
    )


@njit(cache=True)
def place_links(chain: Chain, q: Floats, R: Floats, p: Floats) -> None:
    """Fill R (n + 1, 3, 3) and p (n + 1, 3) with the frames of the links in A, for q (n,)."""
    for a in range(3):
        p[0, a] = 0.0
        for b in range(3):
            R[0, a, b] = 1.0 if a == b else 0.0
    local = np.empty((3, 3))
    for i in range(q.size):
        c, s = math.cos(q[i]), math.sin(q[i])
        for a in range(3):
            for b in range(3):
                local[a, b] = chain.turns[i, 0, a, b] + c * chain.turns[i, 1, a, b] + s * chain.turns[i, 2, a, b]
        for a in range(3):
            x, y, z = R[i, a, 0], R[i, a, 1], R[i, a, 2]
            p[i + 1, a] = p[i, a] + x * chain.offsets[i, 0] + y * chain.offsets[i, 1] + z * chain.offsets[i, 2]
            for b in range(3):
                R[i + 1, a, b] = x * local[0, b] + y * local[1, b] + z * local[2, b]


@njit(cache=True)
def place_all(chain: Chain, q: Floats) -> Floats:
    """(t, n + 1, 4, 4) frames of the links in A, for q (t, n)."""
    t, n = q.shape
    poses = np.zeros((t, n + 1, 4, 4))
    R, p = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    for k in range(t):
        place_links(chain, q[k], R, p)
        for i in range(n + 1):
            for a in range(3):
                poses[k, i, a, 3] = p[i, a]
                for b in range(3):
                    poses[k, i, a, b] = R[i, a, b]
            poses[k, i, 3, 3] = 1.0
    return poses


@njit(cache=True)
def fill_jacobian(chain: Chain, R: Floats, p: Floats, x: float, y: float, z: float, J: Floats) -> None:
    """Fill J (6, n): velocity of the last link's point that is at x y z in A, then its angular velocity, axes of A."""
    for i in range(J.shape[1]):
        u = np.empty(3)
        for a in range(3):
            u[a] = (
                R[i + 1, a, 0] * chain.axes[i, 0]
                + R[i + 1, a, 1] * chain.axes[i, 1]
                + R[i + 1, a, 2] * chain.axes[i, 2]
            )
        rx, ry, rz = x - p[i + 1, 0], y - p[i + 1, 1], z - p[i + 1, 2]
        J[0, i] = u[1] * rz - u[2] * ry
        J[1, i] = u[2] * rx - u[0] * rz
        J[2, i] = u[0] * ry - u[1] * rx
        J[3, i], J[4, i], J[5, i] = u[0], u[1], u[2]


@njit(cache=True)
def jacobian_at(chain: Chain, q: Floats, p_A: Floats) -> Floats:
    """(6, n) for q (n,) and the point p_A (3,) of the last link."""
    n = q.size
    R, p, J = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((6, n))
    place_links(chain, q, R, p)
    fill_jacobian(chain, R, p, p_A[0], p_A[1], p_A[2], J)
    return J


@njit(cache=True)
def torques_at(chain: Chain, q: Floats, p_A: Floats, forces_A: Floats) -> Floats:
    """(t, n) J^T f for the postures q (t, n) and forces forces_A (t, 3) at points p_A (t, 3) of the last link."""
    t, n = q.shape
    torques = np.empty((t, n))
    R, p, J = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((6, n))
    for k in range(t):
        place_links(chain, q[k], R, p)
        fill_jacobian(chain, R, p, p_A[k, 0], p_A[k, 1], p_A[k, 2], J)
        for i in range(n):
            torques[k, i] = J[0, i] * forces_A[k, 0] + J[1, i] * forces_A[k, 1] + J[2, i] * forces_A[k, 2]
    return torques


@njit(cache=True)
def _rotation_error(R_from: Floats, R_to: Floats, error: Floats) -> None:
    """Fill error (3,) with the rotation vector, in A, that takes R_from to R_to."""
    D = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            D[a, b] = R_to[a, 0] * R_from[b, 0] + R_to[a, 1] * R_from[b, 1] + R_to[a, 2] * R_from[b, 2]
    error[0] = 0.5 * (D[2, 1] - D[1, 2])
    error[1] = 0.5 * (D[0, 2] - D[2, 0])
    error[2] = 0.5 * (D[1, 0] - D[0, 1])
    sine = math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
    cosine = 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0)
    if sine > 1e-6:
        error *= math.atan2(sine, cosine) / sine
    elif cosine < 0.0:  # half a turn: the axis is the column of D + 1 that is longest
        a = 0
        for b in range(1, 3):
            if D[b, b] > D[a, a]:
                a = b
        length = math.sqrt(max(2.0 * (D[a, a] + 1.0), 1e-12))
        for b in range(3):
            error[b] = math.pi * (D[b, a] + (1.0 if a == b else 0.0)) / length


@njit(cache=True)
def _damped_step(J: Floats, error: Floats, free: Floats, damping: float, step: Floats) -> None:
    """Fill step (n,) with J^T (J J^T + damping)^-1 error, over the columns of J that are free (1.0)."""
    L, y = np.empty((6, 6)), np.empty(6)
    for a in range(6):  # Cholesky
        for b in range(a + 1):
            total = damping if a == b else 0.0
            for i in range(J.shape[1]):
                total += free[i] * J[a, i] * J[b, i]
            for c in range(b):
                total -= L[a, c] * L[b, c]
            L[a, b] = math.sqrt(max(total, 1e-30)) if a == b else total / L[b, b]
    for a in range(6):
        total = error[a]
        for c in range(a):
            total -= L[a, c] * y[c]
        y[a] = total / L[a, a]
    for a in range(5, -1, -1):
        total = y[a]
        for c in range(a + 1, 6):
            total -= L[c, a] * y[c]
        y[a] = total / L[a, a]
    for i in range(J.shape[1]):
        step[i] = 0.0
        for a in range(6):
            step[i] += free[i] * J[a, i] * y[a]


@njit(cache=True)
def reach_for(chain: Chain, R_AT: Floats, p_AT: Floats, q: Floats) -> bool:
    """Change the posture q (n,) until the flange is at R_AT, p_AT; whether it got there, within the limits."""
    n = q.size
    away = math.sqrt(
        (p_AT[0] - chain.offsets[0, 0]) ** 2
        + (p_AT[1] - chain.offsets[0, 1]) ** 2
        + (p_AT[2] - chain.offsets[0, 2]) ** 2
    )
    if away > chain.reach:
        return False
    seed = q.copy()
    R, p, J = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((6, n))
    R_now, p_now = np.empty((3, 3)), np.empty(3)
    error, turn, step, free = np.empty(6), np.empty(3), np.empty(n), np.empty(n)
    for i in range(n):
        q[i] = min(max(q[i], chain.low[i]), chain.high[i])
    best, waited = np.inf, 0
    for _ in range(ITERATIONS):
        place_links(chain, q, R, p)
        for a in range(3):
            p_now[a] = p[n, a]
            for b in range(3):
                p_now[a] += R[n, a, b] * chain.p_LT[b]
                R_now[a, b] = (
                    R[n, a, 0] * chain.R_LT[0, b] + R[n, a, 1] * chain.R_LT[1, b] + R[n, a, 2] * chain.R_LT[2, b]
                )
        _rotation_error(R_now, R_AT, turn)
        for a in range(3):
            error[a] = p_AT[a] - p_now[a]
            error[3 + a] = turn[a]
        off = math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
        tilt = math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2)
        if off < TOLERANCE and tilt < TOLERANCE:
            for i in range(n):
                if chain.low[i] == -np.inf:  # the nearest of the turns that look the same
                    q[i] -= 2.0 * math.pi * round((q[i] - seed[i]) / (2.0 * math.pi))
            return True
        squared = off * off + tilt * tilt
        if squared < 0.9 * best:
            best, waited = squared, 0
        else:
            waited += 1
            if waited > PATIENCE:
                return False
        fill_jacobian(chain, R, p, p_now[0], p_now[1], p_now[2], J)
        free[:] = 1.0
        for _again in range(n):
            _damped_step(J, error, free, DAMPING * squared + 1e-10, step)
            stopped = False
            for i in range(n):
                beyond = (q[i] <= chain.low[i] and step[i] < 0.0) or (q[i] >= chain.high[i] and step[i] > 0.0)
                if free[i] > 0.0 and beyond:
                    free[i], stopped = 0.0, True
            if not stopped:
                break
        longest = 0.0
        for i in range(n):
            longest = max(longest, abs(step[i]))
        share = min(1.0, LARGEST_STEP / longest) if longest > 0.0 else 0.0
        for i in range(n):
            q[i] = min(max(q[i] + share * step[i], chain.low[i]), chain.high[i])
    return False
