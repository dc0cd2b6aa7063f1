"""How the arm picks up a fragment and sets it down elsewhere: straight paths of the gripper that are free.

The gripper approaches along its needles, lifts straight up, sets straight down and withdraws along its needles.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.paths import Path, find_line, find_posture
from cutgrammar_sim.arm.planning.pressing import NEAR
from cutgrammar_sim.arm.planning.rig import Rig
from cutgrammar_sim.arm.planning.scene import MARGIN, PlanningScene
from cutgrammar_sim.arm.robot.collision import Body
from cutgrammar_sim.physics.convex_hull import hull_corners, hull_of, surface_points

ABOVE = MARGIN + 6e-3
"""Distance at which a carried fragment passes above everything on the board [m]."""
BACK_OFF = 0.06
"""Distance over which the gripper approaches along its needles, and withdraws [m]."""
OVERLAP = 2e-3
"""How far a fragment may reach under another and still be lifted past it [m]."""


@dataclass(frozen=True, eq=False)
class Hold:
    """A way to take hold of a fragment.

    Attributes:
        X_GF: the fragment in the gripper.
        scene: the other fragments, with this one in the gripper.
        down: path of the joints to where the fragment lies.
        lift: path straight up with it.
    """

    X_GF: Pose
    scene: PlanningScene
    down: Path
    lift: Path


@dataclass(frozen=True, eq=False)
class Placing:
    """A way to set down a fragment that is held.

    Attributes:
        X_WF: its pose afterwards.
        down: path of the joints with it, straight down.
        away: path without it, along the needles.
    """

    X_WF: Pose
    down: Path
    away: Path


def find_holds(rig: Rig, fragment: Fragment, grasps: Iterable[Pose], others: PlanningScene) -> Iterator[Hold]:
    """Those of `grasps` that the arm can make, in their order.

    Args:
        rig: the arm with its tool.
        fragment: as it lies, in W.
        grasps: X_WG of the gripper when it has taken hold.
        others: the other fragments on the board, with the gripper extended.
    """
    X_TG = rig.tool.X_TG
    lowest = float(hull_corners(fragment)[:, 2].min())
    rise = max(others.tallest - lowest, 0.0) + ABOVE
    for X_WG in grasps:
        X_GF = X_WG.inverse() @ fragment.X_WF
        held = Body(fragment.mesh, X_TG @ X_GF)
        if not rig.checker.is_clear_of_knife(held):
            continue
        q = find_posture(rig.arm, X_WG, X_TG)
        if q is None or not others.is_free(q, NEAR):
            continue
        back = find_line(rig.arm, X_WG, X_TG, q, BACK_OFF * X_WG.rotation[:, 2])
        if back is None or not others.is_path_free(back, NEAR):
            continue
        lift = find_line(rig.arm, X_WG, X_TG, q, np.array([0.0, 0.0, rise]))
        if lift is not None and others.is_path_free(lift, NEAR):
            yield Hold(X_GF, others.holding(held), back.reversed(), lift)


def posture_to_place(rig: Rig, hold: Hold, X_WF: Pose, others: PlanningScene) -> Floats | None:
    """(n,) posture in which the fragment held is at X_WF and nothing touches; None if there is none."""
    q = find_posture(rig.arm, X_WF @ hold.X_GF.inverse(), rig.tool.X_TG)
    return q if q is not None and others.is_free(q, NEAR) else None


def find_placing(rig: Rig, hold: Hold, X_WF: Pose, q: Floats, others: PlanningScene) -> Placing | None:
    """How the arm sets down at X_WF what it holds, clear of the `others`, in the posture q (n,); None if it cannot."""
    X_TG, X_WG = rig.tool.X_TG, X_WF @ hold.X_GF.inverse()
    up = find_line(rig.arm, X_WG, X_TG, q, np.array([0.0, 0.0, others.tallest + ABOVE]))
    if up is None or not others.is_path_free(up, NEAR):
        return None
    away = find_line(rig.arm, X_WG, X_TG, q, BACK_OFF * X_WG.rotation[:, 2])
    if away is None or not others.is_path_free(away, NEAR):
        return None
    return Placing(X_WF, up.reversed(), away)


def fragments_on_top(fragment: Fragment, now: Configuration) -> tuple[int, ...]:
    """Indices in `now` of the fragments that `fragment` would touch if it were lifted straight up."""
    points = fragment.X_WF.apply(surface_points(fragment.mesh))
    return tuple(index for index, other in enumerate(now) if other is not fragment and _is_above(points, other))


def _is_above(points: Floats, other: Fragment) -> bool:
    """Whether a vertical ray up from any of `points` (k, 3) in W passes through `other`, shrunk by `OVERLAP`."""
    _, _, equations = hull_of(other.mesh)
    normals = other.X_WF.rotate(equations[:, :3])
    offsets = equations[:, 3] - normals @ other.X_WF.position + OVERLAP
    corners = hull_corners(other)
    inside = ((points[:, :2] > corners[:, :2].min(axis=0)) & (points[:, :2] < corners[:, :2].max(axis=0))).all(axis=1)
    points = points[inside & (points[:, 2] < corners[:, 2].max())]
    if not len(points):
        return False
    level = points @ normals.T + offsets  # at the points; along the ray it grows by the normal's z
    up, down = normals[:, 2] > 1e-6, normals[:, 2] < -1e-6
    leaves = np.min(-level[:, up] / normals[up, 2], axis=1)
    enters = np.max(-level[:, down] / normals[down, 2], axis=1)
    beside = (level[:, ~up & ~down] < 0.0).all(axis=1)
    return bool((beside & (leaves > np.maximum(enters, 0.0))).any())
