"""How the arm takes hold of a fragment and sets it down elsewhere: straight ways of the gripper that are free.

The gripper comes along its needles, lifts straight up, sets straight down and withdraws along its needles.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.height_map import Heights, hull_of, surface_points
from cutgrammar_sim.arm.planning.paths import Path, find_line, find_posture
from cutgrammar_sim.arm.planning.pressing import NEAR
from cutgrammar_sim.arm.planning.transit import MARGIN, Surroundings
from cutgrammar_sim.arm.robot.rig import Rig

ABOVE = MARGIN + 6e-3
"""How far what is carried passes above what stands on the board [m]."""
BACK_OFF = 0.06
"""How far the gripper comes along its needles, and withdraws [m]."""
SCRAPE = 2e-3
"""How far a fragment may reach under another and still be lifted past it [m]."""


@dataclass(frozen=True, eq=False)
class Hold:
    """A way to take hold of a fragment.

    Attributes:
        X_GF: how the gripper holds it.
        held_T: (k, 3) points of its surface, in T [m].
        down: the way of the joints to where it lies.
        lift: straight up with it.
    """

    X_GF: Pose
    held_T: Floats
    down: Path
    lift: Path


@dataclass(frozen=True, eq=False)
class Placing:
    """A way to set a fragment down that is held.

    Attributes:
        X_WF: how it stands then.
        down: the way of the joints with it, straight down.
        away: without it, along the needles.
    """

    X_WF: Pose
    down: Path
    away: Path


def find_holds(rig: Rig, fragment: Fragment, grasps: Iterable[Pose], others: Heights) -> Iterator[Hold]:
    """Those of `grasps` that the arm can make, in their order.

    Args:
        rig: the arm with its tool.
        fragment: as it lies, in W.
        grasps: X_WG of the gripper when it has taken hold.
        others: what else stands on the board.
    """
    X_TG = rig.tool.X_TG
    lowest = float(fragment.X_WF.apply(hull_of(fragment.mesh)[0])[:, 2].min())
    rise = max(others.tallest - lowest, 0.0) + ABOVE
    coming = Surroundings(rig.clearance, others, gripper_out=True)
    for X_WG in grasps:
        X_GF = X_WG.inverse() @ fragment.X_WF
        held_T = (X_TG @ X_GF).apply(surface_points(fragment.mesh))
        if not rig.clearance.clear_of(held_T):
            continue
        q = find_posture(rig.arm, X_WG, X_TG, [rig.arm.home])
        if q is None or not rig.clearance.free(q[None], others, NEAR, gripper_out=True):
            continue
        back = find_line(rig.arm, X_WG, X_TG, q, BACK_OFF * X_WG.rotation[:, 2])
        if back is None or not coming.free(back, NEAR):
            continue
        lift = find_line(rig.arm, X_WG, X_TG, q, np.array([0.0, 0.0, rise]))
        if lift is not None and coming.free(lift, NEAR):
            yield Hold(X_GF, held_T, back.reversed(), lift)


def posture_to_place(rig: Rig, hold: Hold, X_WF: Pose, others: Heights) -> Floats | None:
    """(n,) the posture in which what is held stands at X_WF, where there is one and nothing touches."""
    q = find_posture(rig.arm, X_WF @ hold.X_GF.inverse(), rig.tool.X_TG, [rig.arm.home])
    if q is None or not rig.clearance.free(q[None], others, NEAR, gripper_out=True):
        return None
    return q


def find_placing(rig: Rig, hold: Hold, X_WF: Pose, q: Floats, others: Heights) -> Placing | None:
    """How the arm sets down at X_WF what it holds, clear of the `others`, in the posture q (n,); None if it cannot."""
    X_TG, X_WG = rig.tool.X_TG, X_WF @ hold.X_GF.inverse()
    around = Surroundings(rig.clearance, others, gripper_out=True)
    up = find_line(rig.arm, X_WG, X_TG, q, np.array([0.0, 0.0, others.tallest + ABOVE]))
    if up is None or not around.free(up, NEAR):
        return None
    away = find_line(rig.arm, X_WG, X_TG, q, BACK_OFF * X_WG.rotation[:, 2])
    if away is None or not around.free(away, NEAR):
        return None
    return Placing(X_WF, up.reversed(), away)


def lies_under(fragment: Fragment, now: Configuration) -> tuple[int, ...]:
    """Indices in `now` of the fragments over `fragment`, which it would meet if it were lifted straight up."""
    points = fragment.X_WF.apply(surface_points(fragment.mesh))
    return tuple(index for index, other in enumerate(now) if other is not fragment and _meets_above(points, other))


def _meets_above(points: Floats, other: Fragment) -> bool:
    """Whether a vertical ray up from any of `points` (k, 3) in W passes through `other`, less `SCRAPE` all around."""
    _, _, equations = hull_of(other.mesh)
    normals = other.X_WF.rotate(equations[:, :3])
    offsets = equations[:, 3] - normals @ other.X_WF.position + SCRAPE
    corners = other.X_WF.apply(hull_of(other.mesh)[0])
    inside = ((points[:, :2] > corners[:, :2].min(axis=0)) & (points[:, :2] < corners[:, :2].max(axis=0))).all(axis=1)
    points = points[inside & (points[:, 2] < corners[:, 2].max())]
    if not len(points):
        return False
    level = points @ normals.T + offsets  # at the points; higher up it grows by the normal's z
    up, down = normals[:, 2] > 1e-6, normals[:, 2] < -1e-6
    leaves = np.min(-level[:, up] / normals[up, 2], axis=1)
    enters = np.max(-level[:, down] / normals[down, 2], axis=1)
    beside = (level[:, ~up & ~down] < 0.0).all(axis=1)
    return bool((beside & (leaves > np.maximum(enters, 0.0))).any())
