"""Straight strokes with which the finite blade can press a plane through the fragments meant and nothing else.

The blade moves down the steepest line of the plane with its edge level, until the edge is on the board. It sweeps an
area that is as wide as the blade and reaches from the board up, and no fragment that is not meant may be in it. A
stroke chooses which face of the blade looks along the plane's normal, and where along the edge the section is cut.
Whether the arm can make it is decided elsewhere (see `pressing`).
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Refused
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.physics.section import BRUSH, section

MARGIN = 2e-3
"""Length by which the blade must exceed the section at both ends [m]."""
HEADROOM = 0.015
"""Height of the edge above everything when a stroke begins [m]."""
OFFSETS = (0.0, 0.02, -0.02, 0.04, -0.04, 0.06, -0.06, 0.08, -0.08, 0.1, -0.1)
"""Distances of the blade's middle from that of the section along the edge, in the order tried [m]."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A straight press of the blade.

    Attributes:
        X_WB: pose of the blade when the edge has reached the board; it moves along -z of B.
        length: of the movement, from above everything to the board [m].
        depth: last part of the movement, in which the edge may be in the fragments meant [m].
    """

    X_WB: Pose
    length: float
    depth: float


def find_strokes(
    now: Configuration, meant: tuple[int, ...], plane_W: Plane, tool: Tool, max_tilt: float
) -> tuple[Stroke, ...] | Refused:
    """The strokes that cut the fragments `meant` and no others, with the section in the middle of the blade first.

    Args:
        now: the true fragments, meshes, in W.
        meant: indices of those to cut; the plane crosses each.
        plane_W: cutting plane.
        tool: the tool with the blade.
        max_tilt: largest angle between plane and vertical [rad].
    """
    n = plane_W.normal
    lean = float(np.arcsin(min(1.0, abs(n[2]))))
    if lean > max_tilt:
        return Refused(
            f"the plane lies too flat to be pressed: it leans {np.degrees(lean):.0f} degrees from the vertical, "
            f"up to {np.degrees(max_tilt):.0f} would do"
        )
    up = np.array([0.0, 0.0, 1.0]) - n[2] * n
    up /= np.linalg.norm(up)
    edge = np.cross(up, n)
    p_WO = -plane_W.offset * n
    board = -p_WO[2] / up[2]  # coordinate along `up` at which the plane meets the board
    inside = [section(now[index], plane_W) for index in meant]
    across = np.concatenate(inside) @ edge
    left, right = float(across.min()), float(across.max())
    top = float((np.concatenate(inside) @ up).max())
    long, high = right - left, top - board
    if long + 2.0 * MARGIN > tool.length:
        return Refused(
            f"the blade is too short: the section is {1e3 * long:.0f} mm long, the blade {1e3 * tool.length:.0f} mm"
        )
    if high > tool.height:
        return Refused(
            f"the blade is too low: the section is {1e3 * high:.0f} mm high, the blade {1e3 * tool.height:.0f} mm"
        )
    in_the_way = _in_the_way(now, meant, plane_W, edge)
    half = tool.length / 2.0
    first, last = right + MARGIN - half, left - MARGIN + half  # positions of the blade's middle
    free = []
    blockers: set[int] = set()
    for offset in OFFSETS:
        middle = (left + right) / 2.0 + offset
        if not first <= middle <= last:
            continue
        blocking = [i for i, (low, high) in in_the_way if low < middle + half and middle - half < high]
        if blocking:
            blockers.update(blocking)
        else:
            free.append(middle)
    if not free:
        who = ", ".join(str(i) for i in sorted(blockers))
        return Refused(f"a neighbour is in the blade's way: {'fragments' if len(blockers) > 1 else 'fragment'} {who}")
    above = max(float(_corners(fragment)[:, 2].max()) for fragment in now) + HEADROOM
    strokes = []
    for middle in free:
        p_WB = p_WO + middle * edge + board * up
        for x in (n, -n):
            X_WB = Pose(np.column_stack([x, np.cross(up, x), up]), p_WB)
            strokes.append(Stroke(X_WB, above / float(up[2]), high))
    return tuple(strokes)


def _in_the_way(
    now: Configuration, meant: tuple[int, ...], plane_W: Plane, edge: Floats
) -> list[tuple[int, tuple[float, float]]]:
    """Index and extent along the edge of each other fragment that the plane crosses by more than a brush."""
    found = []
    for index, fragment in enumerate(now):
        if index in meant:
            continue
        distances = plane_W.distances(_corners(fragment))
        if not distances.min() < -BRUSH < BRUSH < distances.max():
            continue
        along = section(fragment, plane_W) @ edge
        if float(np.ptp(along)) > 2.0 * BRUSH:
            found.append((index, (float(along.min()) + BRUSH, float(along.max()) - BRUSH)))
    return found


def _corners(fragment: Fragment) -> Floats:
    return fragment.X_WF.apply(fragment.mesh.vertices)
