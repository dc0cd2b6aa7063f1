"""Where the joints pass on the way from one posture to another: along a straight line of the tool, or of the joints."""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.robot.description import X_WA, Arm
from cutgrammar_sim.arm.robot.kinematics import flange_poses, inverse_kinematics

WAYPOINTS = 12e-3
"""Between the waypoints of a straight line of the tool, for which postures are sought [m]."""
OFF_LINE = 1e-5
"""How far the tool, up to `TOOL` from the flange, may be off the line between them [m]."""
TOOL = 0.25
CHECKED = 0.1
"""Between postures of a path that are checked: no joint turns farther [rad]."""


@dataclass(frozen=True, eq=False)
class Path:
    """A smooth curve of postures: the cubic spline through some of them, or the straight line between two.

    Attributes:
        ends: (k,) ascending values of the curve's parameter at the waypoints; from 0.
        waypoints: (k, n) postures there [rad].
        metres: whether the parameter is the way of the tool [m]; else it only tells the order.
    """

    ends: Floats
    waypoints: Floats
    metres: bool = False
    curve: CubicSpline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "ends", frozen_floats(self.ends, (None,), "ends"))
        object.__setattr__(self, "waypoints", frozen_floats(self.waypoints, (len(self.ends), None), "waypoints"))
        object.__setattr__(self, "curve", CubicSpline(self.ends, self.waypoints))

    @property
    def length(self) -> float:
        """The parameter at the end."""
        return float(self.ends[-1])

    def sampled(self) -> Floats:
        """(t, n) postures along the path, no two neighbours farther apart than `CHECKED` in any joint."""
        turning = float(np.abs(np.diff(self.waypoints, axis=0)).max(axis=1).sum())
        return np.asarray(self.curve(np.linspace(0.0, self.length, max(3, int(np.ceil(turning / CHECKED)) + 1))))

    def reversed(self) -> "Path":
        """The same way back."""
        return Path(self.length - self.ends[::-1], self.waypoints[::-1], self.metres)

    def part(self, first: float, last: float) -> "Path":
        """The stretch between two values of the parameter."""
        ends = np.linspace(first, last, len(self.ends))
        return Path(ends - first, self.curve(ends), self.metres)

    def with_turns(self, turns: Floats) -> "Path":
        """The same path with whole turns (n,) added to joints that turn without end [rad]."""
        return Path(self.ends, self.waypoints + turns, self.metres)


def straight(q_from: Floats, q_to: Floats) -> Path:
    """All joints move in proportion from one posture (n,) to another."""
    return Path(np.array([0.0, 1.0]), np.array([q_from, q_to]))


def find_posture(arm: Arm, X_WE: Pose, X_TE: Pose, seeds: list[Floats]) -> Floats | None:
    """The first posture found, from the seeds in their order, in which frame E of the tool is at X_WE."""
    X_AT = X_WA.inverse() @ X_WE @ X_TE.inverse()
    for seed in seeds:
        q = inverse_kinematics(arm, X_AT, seed)
        if q is not None:
            return q
    return None


def find_line(arm: Arm, X_WE: Pose, X_TE: Pose, q: Floats, move_W: Floats) -> Path | None:
    """The tool moves straight by `move_W` (3,) [m] and keeps its orientation.

    Args:
        X_WE: frame E of the tool at the beginning.
        X_TE: E in the flange.
        q: (n,) the posture at the beginning.

    Returns:
        The path, its parameter the way of the tool; None where the arm cannot follow the line smoothly.
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
        if _off(arm, path, between, X_WE, X_ET, move_W / length) < OFF_LINE and _within(arm, path):
            return path
        count = 2 * count - 1
    return None


def nearest_turns(arm: Arm, q_from: Floats, q_to: Floats) -> Floats:
    """(n,) whole turns that bring the joints without end of `q_to` as near as can be to those of `q_from` [rad]."""
    endless = np.array([np.isinf(joint.low) for joint in arm.joints])
    return np.where(endless, 2.0 * np.pi * np.round((q_from - q_to) / (2.0 * np.pi)), 0.0)


def _within(arm: Arm, path: Path) -> bool:
    q = path.sampled()
    return all(bool(joint.low <= q[:, i].min() and q[:, i].max() <= joint.high) for i, joint in enumerate(arm.joints))


def _off(arm: Arm, path: Path, ends: Floats, X_WE: Pose, X_ET: Pose, along_W: Floats) -> float:
    """How far the tool is off its line at most, at the values `ends` of the parameter [m]."""
    X_WT = X_WE @ X_ET
    X_AT = flange_poses(arm, path.curve(ends))
    p_WT = X_WA.apply(X_AT[:, :3, 3])
    wanted = X_WT.position + ends[:, None] * along_W
    turn = np.abs(X_WA.rotation @ X_AT[:, :3, :3] - X_WT.rotation).max()
    return float(np.abs(p_WT - wanted).max() + TOOL * turn)
