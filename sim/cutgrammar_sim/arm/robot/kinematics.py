"""Where an arm's links are, how they move, and which postures reach a pose, computed by Pinocchio.

Frames: A is the arm's base, whose z points up, L a link, T the flange. Inverse kinematics is damped least squares on
the logarithm of the pose error, as Pinocchio's documentation proposes; in addition the damping follows the error, and
a joint at a limit that would go beyond it is left out of the step.
"""

from collections.abc import Iterable

import numpy as np
import pinocchio
from scipy.linalg.lapack import dposv

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import Arm
from cutgrammar_sim.arm.robot.pinocchio_model import model_of, to_se3

TOLERANCE = 1e-7
"""Position and rotation error at which a posture reaches its target [m, rad]."""
MAX_ITERATIONS = 60
"""Iterations after which the search from one seed ends."""
PATIENCE = 12
"""Iterations without a smaller error after which the search gives up."""
DAMPING = 0.02
"""Factor of the squared error that is added to the diagonal of J J^T."""
MAX_STEP = 0.7
"""Greatest change of any joint in one iteration [rad]."""
MIN_DIFFERENCE = 1e-3
"""Postures closer than this in every joint count as one [rad]."""


def link_poses(arm: Arm, q: Floats) -> Floats:
    """(t, n + 1, 4, 4) X_AL of all links, for the postures q (t, n) [rad]."""
    robot, q = model_of(arm), as_postures(arm, q)
    poses = np.zeros((len(q), len(arm.links), 4, 4))
    poses[..., 3, 3] = 1.0
    # Pinocchio hands out views of its workspace, which each call fills anew
    frames = [(robot.data.oMi[i].rotation, robot.data.oMi[i].translation) for i in range(len(arm.links))]
    for X_AL, row in zip(poses, q, strict=True):
        pinocchio.forwardKinematics(robot.model, robot.data, row)
        for X, (rotation, translation) in zip(X_AL, frames, strict=True):
            X[:3, :3], X[:3, 3] = rotation, translation
    return poses


def flange_poses(arm: Arm, q: Floats) -> Floats:
    """(t, 4, 4) X_AT, for the postures q (t, n) [rad]."""
    return np.asarray(link_poses(arm, q)[:, -1] @ model_of(arm).X_LT.homogeneous)


def flange_pose(arm: Arm, q: Floats) -> Pose:
    """X_AT, for the posture q (n,) [rad]."""
    X_AT = flange_poses(arm, q)[0]
    return Pose(X_AT[:3, :3], X_AT[:3, 3])


def jacobian(arm: Arm, q: Floats, p_A: Floats) -> Floats:
    """The Jacobian of a point that is fixed to the last link.

    Args:
        arm: the arm.
        q: (n,) posture [rad].
        p_A: (3,) the point in A [m].

    Returns:
        (6, n) matrix that maps joint velocities to the point's velocity and, below it, the link's angular velocity,
        axes of A. Its transpose maps a force and a torque at the point to joint torques.
    """
    robot = model_of(arm)
    pinocchio.computeJointJacobians(robot.model, robot.data, as_postures(arm, q)[0])
    X_LP = pinocchio.SE3(np.eye(3), robot.data.oMi[robot.last].actInv(np.array(p_A, dtype=np.float64)))
    axes = pinocchio.LOCAL_WORLD_ALIGNED
    return np.asarray(pinocchio.getFrameJacobian(robot.model, robot.data, robot.last, X_LP, axes))


def inverse_kinematics(arm: Arm, X_AT: Pose, seed: Floats) -> Floats | None:
    """A posture with the flange at a pose, within the limits of the joints.

    Args:
        arm: the arm.
        X_AT: pose of the flange, which is reached to 1e-7 m and rad.
        seed: (n,) posture in which the search begins [rad]. A joint without limits ends at the turn nearest to it.

    Returns:
        (n,) [rad], or None where the search from this seed finds none.
    """
    robot = model_of(arm)
    low, high = arm.position_limits.T
    target = to_se3(X_AT) * robot.X_LT.inverse()  # of the last link
    seed = np.array(seed, dtype=np.float64)
    q = np.clip(seed, low, high)
    best, waited = np.inf, 0
    for _ in range(MAX_ITERATIONS):
        pinocchio.computeJointJacobians(robot.model, robot.data, q)
        error = pinocchio.log6(robot.data.oMi[robot.last].actInv(target)).vector
        if np.dot(error[:3], error[:3]) < TOLERANCE**2 and np.dot(error[3:], error[3:]) < TOLERANCE**2:
            turns = np.round((q - seed) / (2.0 * np.pi))
            return np.where(np.isinf(low), q - 2.0 * np.pi * turns, q)
        squared = float(np.dot(error, error))
        best, waited = (squared, 0) if squared < 0.9 * best else (best, waited + 1)
        if waited > PATIENCE:
            return None
        J = pinocchio.getJointJacobian(robot.model, robot.data, robot.last, pinocchio.LOCAL)
        step = _damped_step(J, error, DAMPING * squared + 1e-10)
        for _again in range(q.size):
            beyond = ((q <= low) & (step < 0.0)) | ((q >= high) & (step > 0.0))
            if not beyond.any():
                break
            J[:, beyond] = 0.0
            step = _damped_step(J, error, DAMPING * squared + 1e-10)
        q = np.clip(q + step * min(1.0, MAX_STEP / max(float(np.abs(step).max()), 1e-12)), low, high)
    return None


def solutions(arm: Arm, X_AT: Pose, seeds: Iterable[Floats]) -> list[Floats]:
    """The different postures (n,) that are found from each of `seeds`, in their order."""
    found: list[Floats] = []
    for seed in seeds:
        q = inverse_kinematics(arm, X_AT, seed)
        if q is not None and all(np.abs(q - other).max() > MIN_DIFFERENCE for other in found):
            found.append(q)
    return found


def as_postures(arm: Arm, q: Floats) -> Floats:
    """(t, n) from (t, n) or (n,).

    Raises:
        ValueError: there is not one column for each joint.
    """
    q = np.array(np.atleast_2d(q), dtype=np.float64)
    if q.ndim != 2 or q.shape[1] != len(arm.joints):
        raise ValueError(f"postures of shape {q.shape} for an arm of {len(arm.joints)} joints")
    return q


def _damped_step(J: Floats, error: Floats, damping: float) -> Floats:
    """(n,) the step J^T (J J^T + damping)^-1 error."""
    A = J @ J.T
    A[np.diag_indices(6)] += damping
    _, solved, _ = dposv(A, error)
    return np.asarray(J.T @ solved)
