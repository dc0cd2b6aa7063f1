"""Paths of the joints from one posture to another: along a straight line of the tool, or straight in joint space."""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import X_WA, Arm
from cutgrammar_sim.arm.robot.kinematics import flange_poses, inverse_kinematics

WAYPOINTS = 12e-3
"""Distance between the waypoints of a straight line of the tool [m]."""
MAX_OFF_LINE = 1e-5
"""Maximum distance of the tool from its line between the waypoints [m]."""
REACH = 0.25
"""Distance from the flange up to which `MAX_OFF_LINE` holds [m]."""
CHECK_STEP = 0.1
"""Largest change of any joint between two postures of a path that are checked [rad]."""


@dataclass(frozen=True, eq=False)
class Path:
    """A smooth curve of postures: the cubic spline through some of them, or the straight line between two.

    Attributes:
        knots: (k,) ascending values of the curve's parameter at the waypoints, from 0.
        waypoints: (k, n) postures at these values [rad].
        metres: whether the parameter is the distance that the tool has moved [m]; else it only gives the order.
        curve: the posture (n,) as a function of the parameter.
    """

    knots: Floats
    waypoints: Floats
    metres: bool = False
    curve: CubicSpline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "knots", frozen_floats(self.knots, (None,), "knots"))
        object.__setattr__(self, "waypoints", frozen_floats(self.waypoints, (len(self.knots), None), "waypoints"))
        object.__setattr__(self, "curve", CubicSpline(self.knots, self.waypoints))

    @property
    def length(self) -> float:
        """The parameter at the end."""
        return float(self.knots[-1])

    def sampled(self) -> Floats:
        """(t, n) postures along the path, in which no joint changes by more than `CHECK_STEP` from one to the next."""
        turning = float(np.abs(np.diff(self.waypoints, axis=0)).max(axis=1).sum())
        return np.asarray(self.curve(np.linspace(0.0, self.length, max(3, int(np.ceil(turning / CHECK_STEP)) + 1))))

    def reversed(self) -> "Path":
        """The path backwards."""
        return Path(self.length - self.knots[::-1], self.waypoints[::-1], self.metres)

    def part(self, first: float, last: float) -> "Path":
        """The stretch between two values of the parameter."""
        ends = np.linspace(first, last, len(self.knots))
        return Path(ends - first, self.curve(ends), self.metres)

    def with_turns(self, turns: Floats) -> "Path":
        """The same path with whole turns (n,) added to joints without limits [rad]."""
        return Path(self.knots, self.waypoints + turns, self.metres)


def straight(q_from: Floats, q_to: Floats) -> Path:
    """The path on which all joints move in proportion from one posture (n,) to another."""
    return Path(np.array([0.0, 1.0]), np.array([q_from, q_to]))


def find_posture(arm: Arm, X_WE: Pose, X_TE: Pose) -> Floats | None:
    """The posture (n,) found from home [rad] in which frame E of the tool is at X_WE; None if none is found."""
    return inverse_kinematics(arm, X_WA.inverse() @ X_WE @ X_TE.inverse(), arm.home)


def find_line(arm: Arm, X_WE: Pose, X_TE: Pose, q: Floats, move_W: Floats) -> Path | None:
    """The path on which the tool moves straight by `move_W` (3,) [m] and keeps its orientation.

    Args:
        X_WE: frame E of the tool at the beginning.
        X_TE: frame E in the flange.
        q: (n,) posture at the beginning [rad].

    Returns:
        The path, whose parameter is the distance moved; None where the arm cannot follow the line smoothly.
    """
    X_AW, X_ET = X_WA.inverse(), X_TE.inverse()
    length = float(np.linalg.norm(move_W))
    count = max(4, int(np.ceil(length / WAYPOINTS)) + 1)
    for _ in range(3):
        ends = np.linspace(0.0, length, count)
        postures = [q]
        for end in ends[1:]:
            X_WT = Pose(X_WE.rotation, X_WE.position + end / length * move_W) @ X_ET
            found = inverse_kinematics(arm, X_AW @ X_WT, postures[-1])
            if found is None or np.abs(found - postures[-1]).max() > 0.5:
                return None
            postures.append(found)
        path = Path(ends, np.array(postures), metres=True)
        between = (ends[:-1] + ends[1:]) / 2.0
        if _distance_off(arm, path, between, X_WE, X_ET, move_W / length) < MAX_OFF_LINE and _within(arm, path):
            return path
        count = 2 * count - 1
    return None


def nearest_turns(arm: Arm, q_from: Floats, q_to: Floats) -> Floats:
    """(n,) whole turns that bring joints without limits from `q_to` as near as possible to `q_from` [rad]."""
    unlimited = np.isinf(arm.position_limits[:, 0])
    return np.where(unlimited, 2.0 * np.pi * np.round((q_from - q_to) / (2.0 * np.pi)), 0.0)


def _within(arm: Arm, path: Path) -> bool:
    q, (low, high) = path.sampled(), arm.position_limits.T
    return bool(((low <= q) & (q <= high)).all())


def _distance_off(arm: Arm, path: Path, ends: Floats, X_WE: Pose, X_ET: Pose, along_W: Floats) -> float:
    """Largest distance of the tool from its line at the values `ends` of the parameter [m]."""
    X_WT = X_WE @ X_ET
    X_AT = flange_poses(arm, path.curve(ends))
    p_WT = X_WA.apply(X_AT[:, :3, 3])
    wanted = X_WT.position + ends[:, None] * along_W
    turn = np.abs(X_WA.rotation @ X_AT[:, :3, :3] - X_WT.rotation).max()
    return float(np.abs(p_WT - wanted).max() + REACH * turn)
