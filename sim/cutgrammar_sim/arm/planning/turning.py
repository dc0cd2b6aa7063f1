"""Candidates for picking up, turning and setting down a fragment whose plane cannot be pressed where it lies.

A plane that lies too flat is turned upright by turning the fragment about a level axis. The gripper picks it up with
the tool leaning to one side and sets it down leaning to the other, so that neither lean is large. The board is spiked:
a fragment that is set down stays as it is until it is cut. The candidates come from the geometry alone, best first;
whether the arm can reach them is decided elsewhere (see `carrying`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.arm.planning.strokes import MARGIN
from cutgrammar_sim.arm.robot.tool import Tool
from cutgrammar_sim.physics.convex_hull import hull_corners, hull_of
from cutgrammar_sim.physics.section import section

STANDS = 1.5e-3
"""Corners of a fragment at most this much above its lowest point support it [m]."""
LEANS = (-40.0, 65.0)
"""Range of the tool's lean when picking up and setting down; negative: the knife towards the board [degrees]."""
LEAN_STEP = 10.0
"""Twice the difference between leans that are tried [degrees]."""
NEEDLE_DEPTH = 5e-3
"""Depth of the needles in a fragment that is thick enough [m]."""
SHORT = np.radians(25.0)
"""Angle by which a turn may fall short where no full turn is possible: the plane then leans by it [rad]."""
GAP = 8e-3
"""Free space around a fragment that is set down [m]."""
SPOTS_X = np.linspace(-0.12, 0.14, 14)
SPOTS_Y = np.linspace(-0.24, 0.24, 25)
"""Places on the board for the centroid of a fragment that is set down, in W [m]."""
YAWS = 12
"""Number of headings in which a fragment may be set down."""
SLIT = 4e-3
"""Half the width that must be free where the blade passes beside the fragment [m]."""
SHIFTS = (0.0, 0.06, -0.06)
"""Distances of the section from the middle of the blade for which free space is sought [m]."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A turn about a level axis that brings the plane upright.

    Attributes:
        axis_W: (3,) level unit vector.
        angle: about it, right-handed [rad].
    """

    axis_W: Floats
    angle: float

    @property
    def rotation(self) -> Floats:
        """(3, 3)."""
        return np.asarray(Rotation.from_rotvec(self.angle * self.axis_W).as_matrix())


NO_TURN = Turn(np.array([1.0, 0.0, 0.0]), 0.0)


def find_turns(fragment: Fragment, plane_W: Plane, tool: Tool, max_tilt: float) -> list[Turn]:
    """Turns after which the plane is upright and the blade fits, the smallest first.

    Among turns that differ by less than 15 degrees, those come first after which the fragment stands on a face, and
    then those after which it is lowest. If the plane is steep enough already, no turn at all is the first; turns that
    fall short by `SHORT` are the last.

    Args:
        fragment: a mesh, in W.
        plane_W: plane that crosses it.
        tool: the tool with the blade.
        max_tilt: largest angle between plane and vertical that needs no turn [rad].
    """
    n = plane_W.normal
    lean = float(np.arcsin(min(1.0, abs(n[2]))))
    corners = hull_corners(fragment) - fragment.p_WC
    cut = section(fragment, plane_W).reshape(-1, 3) - fragment.p_WC
    found: list[tuple[tuple[float, ...], Turn]] = []
    if lean <= max_tilt:
        found.append(((-1.0, 0.0, 0.0, 0.0), NO_TURN))
    for azimuth in _azimuths(fragment, n):
        axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        across = np.array([-axis[1], axis[0], 0.0])
        full = float(-np.arctan2(n[2], n @ across))
        full -= np.pi * np.round(full / np.pi)
        both = (full, full - np.sign(full) * np.pi) if abs(full) > np.radians(80.0) else (full,)
        for short, angle in [(0.0, a) for a in both] + [(1.0, a - np.sign(a) * SHORT) for a in both]:
            if abs(angle) < np.radians(1.0) or (short and abs(angle) < SHORT):
                continue
            turn = Turn(axis, float(angle))
            turned = corners @ turn.rotation.T
            low = float(turned[:, 2].min())
            blade = cut @ turn.rotation.T
            edge = np.cross(turn.rotation @ n, [0.0, 0.0, 1.0])
            if np.ptp(blade @ edge) + 2.0 * MARGIN > tool.length or blade[:, 2].max() - low > tool.height:
                continue
            feet = turned[turned[:, 2] < low + STANDS, :2]
            stands = bool((feet.min(axis=0) < 0.0).all() and (feet.max(axis=0) > 0.0).all())
            height = float(turned[:, 2].max()) - low
            found.append(((short, np.round(abs(np.degrees(angle)) / 15.0), 0.0 if stands else 1.0, height), turn))
    return [turn for _, turn in sorted(found, key=lambda pair: pair[0])]


def _azimuths(fragment: Fragment, normal_W: Floats) -> list[float]:
    """Headings of level axes that are worth trying [rad]: along the plane's level lines, and along faces."""
    corners, triangles, equations = hull_of(fragment.mesh)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    normals = fragment.X_WF.rotate(equations[:, :3])
    upright = np.abs(normals[:, 2]) < 0.2
    along = np.mod(np.arctan2(normals[upright, 1], normals[upright, 0]) + np.pi / 2.0, np.pi)
    bins = (along / np.radians(5.0)).astype(int)
    sums = np.bincount(bins, weights=areas[upright], minlength=37)
    faces = [
        float(np.average(along[bins == k], weights=areas[upright][bins == k]))
        for k in np.argsort(-sums)[:3]
        if sums[k] > 0.0
    ]
    level = float(np.arctan2(-normal_W[0], normal_W[1])) if np.hypot(normal_W[0], normal_W[1]) > 0.2 else None
    first = ([] if level is None else [level]) + faces
    base = first[0] if first else 0.0
    return first + [base + np.radians(30.0) * k for k in range(1, 6)]


def find_grasps(fragment: Fragment, turn: Turn) -> Iterator[Pose]:
    """Poses X_WG of the gripper that holds `fragment` from above its centroid, the smallest lean first.

    Before and after the turn the tool leans within `LEANS`, and its edge is level.
    """
    p_WC = fragment.p_WC
    span = surface_above(fragment, p_WC[:2])
    if span is None:
        return
    depth = min(NEEDLE_DEPTH, 0.4 * (span[1] - span[0]))
    p_WG = np.array([p_WC[0], p_WC[1], span[1]])
    low, high = np.radians(LEANS)
    choices: list[tuple[tuple[float, ...], Floats]] = []
    if turn.angle == 0.0:
        choices = [((0.0, float(k)), _leaning(np.pi / 4.0 * k, 0.0)) for k in range(8)]
    else:
        yaw = float(np.arctan2(-turn.axis_W[0], turn.axis_W[1]))  # y of G along the axis
        for flip, sign in ((0.0, 1.0), (np.pi, -1.0)):
            for lean in np.radians(np.arange(LEANS[0], LEANS[1] + 0.1, LEAN_STEP / 2.0)):
                after = lean + sign * turn.angle
                if low - 1e-9 <= after <= high + 1e-9:
                    cost = max(abs(lean), abs(after)) + 0.3 * max(0.0, -min(lean, after))
                    choices.append(((float(np.round(cost, 9)), flip, float(lean)), _leaning(yaw + flip, float(lean))))
    for _, rotation in sorted(choices, key=lambda pair: pair[0]):
        yield Pose(rotation, p_WG - depth * rotation[:, 2])


def _leaning(yaw: float, lean: float) -> Floats:
    """(3, 3) rotation by `lean` about y, then by `yaw` about the vertical."""
    return np.asarray(Rotation.from_euler("ZY", [yaw, lean]).as_matrix())


def surface_above(fragment: Fragment, xy: Floats) -> tuple[float, float] | None:
    """Lower and upper end of the topmost stretch of a vertical line through `xy` (2,) in the fragment [m], or None."""
    triangles = fragment.X_WF.apply(fragment.mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    a, b, c = (triangles[:, i] - np.append(xy, 0.0) for i in range(3))
    wa, wb, wc = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b)))
    total = wa + wb + wc
    inside = ((wa >= 0.0) & (wb >= 0.0) & (wc >= 0.0)) | ((wa <= 0.0) & (wb <= 0.0) & (wc <= 0.0))
    inside &= np.abs(total) > 1e-15
    if inside.sum() < 2:
        return None
    heights = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2])[inside] / total[inside]
    top = float(heights.max())
    under = heights[heights < top - 1e-6]
    return (float(under.max()), top) if len(under) else None


def find_spots(fragment: Fragment, turn: Turn, plane_W: Plane, tool: Tool, occupied: Floats) -> Iterator[Pose]:
    """Poses X_WF of the turned fragment in free places, nearest to the middle of the board first.

    Args:
        fragment: as it lies, in W.
        turn: the turn.
        plane_W: cutting plane; beside the fragment there must be room for the blade in it.
        tool: the tool with the blade.
        occupied: (k, 2) x and y of the cells that other fragments cover, in W [m].
    """
    p_WC = fragment.p_WC
    points = (hull_corners(fragment) - p_WC) @ turn.rotation.T
    n = turn.rotation @ plane_W.normal
    cut = (section(fragment, plane_W).reshape(-1, 3) - p_WC) @ turn.rotation.T
    heading = float(np.arctan2(n[1], n[0]))
    n_level = np.array([np.cos(heading), np.sin(heading)])
    edge = np.array([-n_level[1], n_level[0]])
    body = points[:, :2] @ np.column_stack([n_level, edge])
    blade = cut[:, :2] @ np.column_stack([n_level, edge])
    middle = float(blade[:, 1].min() + blade[:, 1].max()) / 2.0
    reach = (tool.length - float(np.ptp(blade[:, 1]))) / 2.0 - MARGIN
    boxes = [_with_gap(body)]
    for shift in SHIFTS:
        if abs(shift) <= max(reach, 0.0):
            at = middle + shift
            boxes.append(
                [blade[:, 0].min() - SLIT, blade[:, 0].max() + SLIT, at - tool.length / 2.0, at + tool.length / 2.0]
            )
    yield from _spots(fragment, turn, np.zeros(2), heading, np.array(boxes), occupied)


def find_spots_aside(fragment: Fragment, occupied: Floats) -> Iterator[Pose]:
    """Poses X_WF of the fragment, not turned over, in free places, nearest to where it lies first; see `find_spots`."""
    body = hull_corners(fragment)[:, :2] - fragment.p_WC[:2]
    yield from _spots(fragment, NO_TURN, fragment.p_WC[:2], 0.0, np.array([_with_gap(body)]), occupied)


def _with_gap(outline: Floats) -> list[float]:
    """The box [u0, u1, v0, v1] around points (k, 2) and the free space that they need."""
    (u0, v0), (u1, v1) = outline.min(axis=0) - GAP, outline.max(axis=0) + GAP
    return [u0, u1, v0, v1]


def _spots(
    fragment: Fragment, turn: Turn, near: Floats, heading: float, boxes: Floats, occupied: Floats
) -> Iterator[Pose]:
    """Poses X_WF of the turned fragment on a grid where its boxes (see `_free`) are free, nearest to `near` first."""
    rise = -float(((hull_corners(fragment) - fragment.p_WC) @ turn.rotation.T)[:, 2].min())
    spots = np.stack(np.meshgrid(SPOTS_X, SPOTS_Y, indexing="ij"), axis=-1).reshape(-1, 2)
    spots = spots[np.argsort(np.linalg.norm(spots - near, axis=1), kind="stable")]
    yaws = np.array([(-1.0) ** k * np.ceil(k / 2.0) for k in range(YAWS)]) * 2.0 * np.pi / YAWS
    for some in np.array_split(spots, len(spots) // 10):
        for k, i in zip(*np.nonzero(_free(some, yaws + heading, boxes, occupied)), strict=True):
            rotation = np.asarray(Rotation.from_euler("Z", yaws[i]).as_matrix()) @ turn.rotation
            turned = rotation @ fragment.X_WF.rotation
            yield Pose(turned, np.append(some[k], rise) - turned @ fragment.mesh.centroid)


@njit(cache=True)
def _free(spots: Floats, headings: Floats, boxes: Floats, occupied: Floats) -> NDArray[np.bool_]:
    """(k, m) whether at spot k, heading m the first box and, if there are others, any of these are free.

    Boxes are [u0, u1, v0, v1].
    """
    found = np.zeros((len(spots), len(headings)), dtype=np.bool_)
    blocked = np.zeros(len(boxes), dtype=np.bool_)
    far = 0.0  # radius about the spot of all boxes
    for j in range(len(boxes)):
        far = max(far, np.hypot(np.abs(boxes[j, :2]).max(), np.abs(boxes[j, 2:]).max()))
    for k in range(len(spots)):
        for m in range(len(headings)):
            c, s = np.cos(headings[m]), np.sin(headings[m])
            blocked[:] = False
            n_open = len(boxes) - 1
            for i in range(len(occupied)):
                x, y = occupied[i, 0] - spots[k, 0], occupied[i, 1] - spots[k, 1]
                if abs(x) > far or abs(y) > far:
                    continue
                u, v = c * x + s * y, c * y - s * x
                for j in range(len(boxes)):
                    if not blocked[j] and boxes[j, 0] < u < boxes[j, 1] and boxes[j, 2] < v < boxes[j, 3]:
                        blocked[j] = True
                        n_open -= j > 0
                if blocked[0] or (n_open == 0 and len(boxes) > 1):
                    break
            found[k, m] = not blocked[0] and (n_open > 0 or len(boxes) == 1)
    return found
