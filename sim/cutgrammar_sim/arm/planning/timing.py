"""Timing of a path: as fast as the arm's limits allow, from rest to rest.

Time-optimal by toppra's reachability analysis (TOPP-RA), with limits on velocities, accelerations and torques of the
joints and, for straight movements of the tool, on its speed. Torque limits are imposed only where the timing without
them exceeds them, for they cost most of the computing time and are hardly ever active.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint
from toppra.interpolator import AbstractGeometricPath

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.settings import KinovaSettings
from cutgrammar_sim.arm.planning.loads import Pushes, pushed_torques
from cutgrammar_sim.arm.planning.paths import Path
from cutgrammar_sim.arm.robot.description import X_WA, Arm
from cutgrammar_sim.arm.robot.dynamics import Load, inverse_dynamics
from cutgrammar_sim.arm.robot.kinematics import flange_poses

STEP = 1.0 / 240.0
"""Time between two samples of a trajectory: the step of the physics [s]."""
GRID = 41
"""Number of points of a path at which the limits are imposed."""
HEADROOM, TORQUE_HEADROOM = 0.95, 0.93
"""Share of the limits on accelerations and torques imposed there, for between the points they are exceeded a little."""
TORQUE_SHARE = 0.9
"""Share of the motors' torques that a plan may use."""
STRIDE = 4
"""Torques are checked at every sample of this stride."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A timed movement of the joints, at rest at both ends.

    Attributes:
        times: (t,) from 0 in steps of `STEP` [s].
        positions, velocities, accelerations: (t, n) of the joints [rad, rad/s, rad/s2].
    """

    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", frozen_floats(self.times, (None,), "times"))
        for name in ("positions", "velocities", "accelerations"):
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (len(self.times), None), name))


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the joints.

    Attributes:
        velocity: (n,) [rad/s].
        acceleration: of every joint [rad/s2].
        torque: (n,) [N m].
    """

    velocity: Floats
    acceleration: float
    torque: Floats


@dataclass(frozen=True, eq=False)
class ExternalLoad:
    """What loads the arm during a movement.

    Attributes:
        loads: bodies fixed to the flange.
        force_W: (3,) force of the food on the blade [N].
        p_TP: (3,) point at which it acts, in T [m].
    """

    loads: tuple[Load, ...]
    force_W: Floats = field(default_factory=lambda: np.zeros(3))
    p_TP: Floats = field(default_factory=lambda: np.zeros(3))


def limits_of(arm: Arm, settings: KinovaSettings) -> Limits:
    """The limits that the settings give the joints of `arm`."""
    return Limits(
        settings.velocity_share * arm.velocity_limits,
        settings.max_acceleration,
        TORQUE_SHARE * arm.torque_limits,
    )


def find_trajectory(
    arm: Arm, path: Path, limits: Limits, load: ExternalLoad, speed: float = np.inf
) -> Trajectory | None:
    """Find the fastest movement along `path` within the limits, from rest to rest; None where the motors are too weak.

    Args:
        path: of the joints.
        limits: of the joints.
        load: that the motors bear during the movement.
        speed: maximum of the tool, for a path whose parameter is the distance that it moves [m/s].
    """
    for with_torques in (False, True):
        grid = np.linspace(0.0, path.length, GRID)
        constraint = _Constraint(arm, limits, load, speed, with_torques)
        solver = TOPPRA([constraint], _Curve(path), grid, solver_wrapper="seidel")
        _, rates, _ = solver.compute_parameterization(0.0, 0.0)
        if rates is None or not np.isfinite(rates).all():
            return None
        trajectory = _sampled(path, grid, rates, limits)
        some = np.append(np.arange(0, len(trajectory.times) - 1, STRIDE), len(trajectory.times) - 1)
        torques = _torques(
            arm, trajectory.positions[some], trajectory.velocities[some], trajectory.accelerations[some], load
        )
        if (np.abs(torques) <= limits.torque).all():
            return trajectory
    return None


def resting(q: Floats) -> Trajectory:
    """No movement in the posture q (n,)."""
    still = np.zeros((1, len(q)))
    return Trajectory(np.zeros(1), q[None], still, still)


def joined(trajectories: Sequence[Trajectory]) -> Trajectory:
    """Several movements as one; each begins where the one before it ends."""
    first, *others = trajectories
    positions, velocities, accelerations = (
        np.concatenate([getattr(first, name), *(getattr(other, name)[1:] for other in others)])
        for name in ("positions", "velocities", "accelerations")
    )
    return Trajectory(np.arange(len(positions)) * np.float64(STEP), positions, velocities, accelerations)


def _sampled(path: Path, grid: Floats, rates: Floats, limits: Limits) -> Trajectory:
    """The movement whose rate of the path's parameter is `rates` on `grid`, with constant acceleration in between."""
    spans = 2.0 * np.diff(grid) / (rates[:-1] + rates[1:])
    reached = np.concatenate([[0.0], np.cumsum(spans)])
    gains = np.diff(rates) / spans
    total, slower = reached[-1], 1.0
    for _ in range(5):  # slower each time, while a limit is exceeded between the points of the grid
        steps = max(1, int(np.ceil(total * slower / STEP)))
        share = steps * STEP / total
        at = np.linspace(0.0, total, steps + 1)
        stretch = np.clip(np.searchsorted(reached, at, side="right") - 1, 0, len(gains) - 1)
        into = at - reached[stretch]
        s = np.minimum(grid[stretch] + (rates[stretch] + 0.5 * gains[stretch] * into) * into, grid[-1])
        rate = (rates[stretch] + gains[stretch] * into)[:, None]
        slope, bend = path.curve(s, 1), path.curve(s, 2)
        velocities = slope * rate / share
        accelerations = (bend * rate**2 + slope * gains[stretch, None]) / share**2
        positions = path.curve(s)
        positions[0], positions[-1] = path.waypoints[0], path.waypoints[-1]
        velocities[[0, -1]] = 0.0
        over = max(
            1.0,
            float(np.abs(velocities / limits.velocity).max()),
            float(np.sqrt(np.abs(accelerations).max() / limits.acceleration)),
        )
        if over == 1.0:
            break
        slower *= over * (1.0 + 1e-3)
    return Trajectory(np.arange(steps + 1) * np.float64(STEP), positions, velocities, accelerations)


def _torques(arm: Arm, q: Floats, qd: Floats, qdd: Floats, load: ExternalLoad) -> Floats:
    torques = inverse_dynamics(arm, q, qd, qdd, load.loads)
    if not load.force_W.any():
        return torques
    X_AT = flange_poses(arm, q)
    p_WP = X_WA.apply(X_AT[:, :3, :3] @ load.p_TP + X_AT[:, :3, 3])
    return torques + pushed_torques(arm, q, Pushes(np.tile(load.force_W, (len(q), 1)), p_WP))


class _Curve(AbstractGeometricPath):  # type: ignore[misc,unused-ignore]
    """A path as toppra reads it."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, path_positions: Any, order: int = 0) -> Any:
        return self._path.curve(path_positions, order)

    @property
    def dof(self) -> int:
        return int(self._path.waypoints.shape[1])

    @property
    def path_interval(self) -> Any:
        return np.array([0.0, self._path.length])


class _Constraint(LinearConstraint):  # type: ignore[misc,unused-ignore]
    """All limits at once, as toppra reads them: F (a u + b x + c) <= g and x within bounds.

    x is the square of the rate of the path's parameter, u its acceleration.
    """

    def __init__(self, arm: Arm, limits: Limits, load: ExternalLoad, speed: float, with_torques: bool) -> None:
        super().__init__()
        self.identical = True
        self._arm, self._limits, self._load, self._speed = arm, limits, load, speed
        self._with_torques = with_torques

    def compute_constraint_params(self, path: Any, gridpoints: Any, *_: Any, **__: Any) -> Any:
        slope, bend = path(gridpoints, 1), path(gridpoints, 2)
        n = slope.shape[1]
        fastest = np.abs(slope) / self._limits.velocity
        max_rate = np.minimum(1.0 / np.maximum(fastest.max(axis=1), 1e-9), self._speed)
        bounds = np.column_stack([np.zeros(len(max_rate)), max_rate**2])
        a, b, c = slope, bend, np.zeros_like(slope)
        g = np.full(n, HEADROOM * self._limits.acceleration)
        if self._with_torques:
            q, still = path(gridpoints), np.zeros_like(slope)
            hold = _torques(self._arm, q, still, still, self._load)
            a = np.hstack([a, _torques(self._arm, q, still, slope, self._load) - hold])
            b = np.hstack([b, _torques(self._arm, q, slope, bend, self._load) - hold])
            c = np.hstack([c, hold])
            g = np.concatenate([g, TORQUE_HEADROOM * self._limits.torque])
        eye = np.eye(len(g))
        return a, b, c, np.vstack([eye, -eye]), np.concatenate([g, g]), None, bounds
