"""How a free knife comes to a fragment: the stroke that cuts it and nothing else.

The knife moves within the cutting plane, edge first, and its blade is as wide as the section of the fragments meant.
Of a fixed fan of directions, the most downward first, the first is taken whose sweep passes no other fragment and does
not enter the board. The blade counts as flat: its thickness matters only when it parts the halves.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.seams import Refused

DIRECTIONS = 16
"""Directions tried, evenly spread within the cutting plane."""

BRUSH = 0.5e-3
"""How far the blade may enter the board or another fragment without harm [m]."""

HEADROOM = 0.02
"""How far the blade's edge is from the section before the stroke, and how much of the blade stays out after it [m]."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A straight movement of the blade within the cutting plane.

    Attributes:
        along_W: (3,) unit direction in which the edge moves.
        across_W: (3,) unit direction of the edge.
        p_WE: (3,) middle of the edge before the stroke, in W [m].
        width: of the blade, along the edge [m].
        height: of the blade, against the movement [m].
        length: of the movement [m].
    """

    along_W: Floats
    across_W: Floats
    p_WE: Floats
    width: float
    height: float
    length: float


def find_stroke(now: Configuration, meant: tuple[int, ...], plane_W: Plane) -> Stroke | Refused:
    """The first stroke of the fan that divides the fragments `meant` and leaves the others and the board alone.

    Args:
        now: the true fragments, meshes, in W.
        meant: indices of those to cut; the plane crosses each.
        plane_W: cutting plane.
    """
    sections = [section(fragment, plane_W) for fragment in now]
    goal = np.concatenate([sections[index] for index in meant]).reshape(-1, 3)
    blocked: list[str] = []
    for along_W in fan(plane_W.normal):
        across_W = np.cross(plane_W.normal, along_W)
        width, depth = goal @ across_W, goal @ along_W
        height = float(np.ptp(depth)) + HEADROOM
        front = float(depth.max())
        box = (float(width.min()), float(width.max()), front - 2.0 * height, front)  # where any of the blade passes
        p_WO = -plane_W.offset * plane_W.normal  # a point of the plane: in it, positions are p_WO + w across + d along
        corners = [p_WO + w * across_W + d * along_W for w in box[:2] for d in box[2:]]
        if min(corner[2] for corner in corners) < -BRUSH:
            blocked.append("board")
        elif any(
            _enters(segments, across_W, along_W, box) for index, segments in enumerate(sections) if index not in meant
        ):
            blocked.append("neighbour")
        else:
            p_WE = p_WO + (box[0] + box[1]) / 2.0 * across_W + (front - height) * along_W
            return Stroke(along_W, across_W, p_WE, box[1] - box[0], height, height)
    if "neighbour" in blocked:
        return Refused(
            f"would cut a neighbour: of {DIRECTIONS} directions {blocked.count('neighbour')} pass another fragment, "
            f"{blocked.count('board')} enter the board"
        )
    return Refused("the plane cannot be reached without cutting into the board")


def section(fragment: Fragment, plane_W: Plane) -> Floats:
    """(m, 2, 3) segments in W where the plane meets the fragment's triangles [m]; m = 0 where it misses."""
    triangles = fragment.X_WF.apply(fragment.mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    distances = plane_W.distances(triangles.reshape(-1, 3)).reshape(-1, 3)
    above = distances >= 0.0
    crossing = above.any(axis=1) & ~above.all(axis=1)
    triangles, distances, above = triangles[crossing], distances[crossing], above[crossing]
    # Turn each triangle so that its first corner is the one alone on its side; both edges from there are crossed.
    lone_is_above = above.sum(axis=1) == 1
    turn = (np.argmax(above == lone_is_above[:, None], axis=1)[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(triangles, turn[:, :, None], axis=1)
    heights = np.take_along_axis(distances, turn, axis=1)
    share = heights[:, :1] / (heights[:, :1] - heights[:, 1:])
    return np.asarray(corners[:, :1] + share[:, :, None] * (corners[:, 1:] - corners[:, :1]))


def fan(normal_W: Floats) -> list[Floats]:
    """`DIRECTIONS` unit directions within the plane across `normal_W`, the most downward first."""
    steepest = normal_W[2] * normal_W - np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(steepest) < 1e-6:  # the plane lies flat: begin anywhere
        steepest = np.cross(normal_W, [1.0, 0.0, 0.0])
    down = steepest / np.linalg.norm(steepest)
    side = np.cross(normal_W, down)
    order = sorted(range(DIRECTIONS), key=lambda i: (min(i, DIRECTIONS - i), i))
    angles = [2.0 * np.pi * i / DIRECTIONS for i in order]
    # cos and sin of a quarter turn are exact zeros here, so that a level stroke is level.
    return [np.round(np.cos(angle), 15) * down + np.round(np.sin(angle), 15) * side for angle in angles]


def _enters(segments: Floats, across_W: Floats, along_W: Floats, box: tuple[float, float, float, float]) -> bool:
    """Whether any of the segments (m, 2, 3) lies in the swept rectangle by more than `BRUSH`."""
    if not len(segments):
        return False
    left, right, back, front = box[0] + BRUSH, box[1] - BRUSH, box[2], box[3] - BRUSH
    ends = np.stack([segments @ across_W, segments @ along_W], axis=-1)
    ends = np.take_along_axis(ends, np.argsort(ends[:, :, :1], axis=1), axis=1)
    (w0, d0), (w1, d1) = ends[:, 0].T, ends[:, 1].T
    inside = (w1 > left) & (w0 < right)
    span = np.where(w1 > w0, w1 - w0, 1.0)
    enter = d0 + (d1 - d0) * np.clip((left - w0) / span, 0.0, 1.0)
    leave = np.where(w1 > w0, d0 + (d1 - d0) * np.clip((right - w0) / span, 0.0, 1.0), d1)
    return bool((inside & (np.minimum(enter, leave) < front) & (np.maximum(enter, leave) > back)).any())
