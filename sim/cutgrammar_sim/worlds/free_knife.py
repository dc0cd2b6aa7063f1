"""The stroke with which a free knife, one that no arm holds, cuts a fragment and nothing else.

The knife moves within the cutting plane in one straight direction, and its blade is as wide as the section of the
fragments meant. It is treated as a narrow blade whose tip follows the far side of the section, so it passes only the
section and its shadow on the side that the knife comes from. Directions of a fixed fan are tried, the most downward
first, and the first is taken whose shadow contains no other fragment and does not reach under the board. The blade
counts as flat: its thickness only matters for the gap between the halves.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Refused
from cutgrammar_sim.physics.section import BRUSH, section

DIRECTIONS = 64
"""Number of directions, evenly spread within the cutting plane: enough to pass between slices that lean."""

HEADROOM = 0.02
"""Distance of the edge from the section before the stroke, and height of the blade that stays out after it [m]."""

LINES = 101
"""Number of lines along the movement on which the section and what lies in front of it are compared."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A straight movement of the blade within the cutting plane.

    Attributes:
        along_W: (3,) unit direction in which the edge moves.
        p_WE: (3,) middle of the edge before the stroke, in W [m].
        width: of the blade, along the edge [m].
        height: of the blade, against the movement [m].
        length: of the movement [m].
    """

    along_W: Floats
    p_WE: Floats
    width: float
    height: float
    length: float


def find_stroke(now: Configuration, meant: tuple[int, ...], plane_W: Plane) -> Stroke | Refused:
    """The first stroke of the fan that divides the fragments `meant` and touches neither the others nor the board.

    Args:
        now: the true fragments, meshes, in W.
        meant: indices of the fragments to cut; the plane crosses each.
        plane_W: cutting plane.
    """
    sections = [section(fragment, plane_W) for fragment in now]
    goal = np.concatenate([sections[index] for index in meant])
    others = np.concatenate([np.empty((0, 2, 3)), *(sections[i] for i in range(len(now)) if i not in meant)])
    p_WO = -plane_W.offset * plane_W.normal  # points of the plane are p_WO + w across + d along
    passing = 0
    for along_W in fan(plane_W.normal):
        across_W = np.cross(plane_W.normal, along_W)
        width, depth = goal @ across_W, goal @ along_W
        left, right, front = float(width.min()), float(width.max()), float(depth.max())
        height = float(np.ptp(depth)) + HEADROOM
        back = front - 2.0 * height  # the blade's other side before the stroke
        if along_W[2] > 0.0 and min((p_WO + w * across_W + back * along_W)[2] for w in (left, right)) < -BRUSH:
            continue
        if _shades(others @ across_W, others @ along_W, width, depth, back):
            passing += 1
            continue
        p_WE = p_WO + (left + right) / 2.0 * across_W + (front - height) * along_W
        return Stroke(along_W, p_WE, right - left, height, height)
    return Refused(
        f"would cut a neighbour: of {DIRECTIONS} directions within the plane {passing} pass another fragment, "
        f"{DIRECTIONS - passing} come from under the board"
    )


def fan(normal_W: Floats) -> list[Floats]:
    """`DIRECTIONS` unit directions within the plane across `normal_W`, the most downward first."""
    steepest = normal_W[2] * normal_W - np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(steepest) < 1e-6:  # the plane is level: any direction is as good
        steepest = np.cross(normal_W, [1.0, 0.0, 0.0])
    down = steepest / np.linalg.norm(steepest)
    side = np.cross(normal_W, down)
    order = sorted(range(DIRECTIONS), key=lambda i: (min(i, DIRECTIONS - i), i))
    angles = [2.0 * np.pi * i / DIRECTIONS for i in order]
    # cos and sin of a quarter turn are exact zeros here, so that a level stroke is level.
    return [np.round(np.cos(angle), 15) * down + np.round(np.sin(angle), 15) * side for angle in angles]


def _shades(w: Floats, d: Floats, width: Floats, depth: Floats, back: float) -> bool:
    """Whether segments with ends (m, 2) across and (m, 2) along lie in front of the section by more than `BRUSH`.

    Args:
        w, d: positions of the segments across and along the movement [m].
        width, depth: the same of the section's own segments, (n, 2) each [m].
        back: segments before this depth are out of the blade's way [m].
    """
    low, high = float(width.min()) + BRUSH, float(width.max()) - BRUSH
    near = (w.max(axis=1) > low) & (w.min(axis=1) < high) & (d.max(axis=1) > back) & (d.min(axis=1) < depth.max())
    if not near.any() or high <= low:
        return False
    lines = np.linspace(low, high, LINES)
    first = -_deepest(w[near], -d[near], lines)
    return bool((first < _deepest(width, depth, lines) - BRUSH).any())


def _deepest(w: Floats, d: Floats, lines: Floats) -> Floats:
    """(k,) largest depth of segments with ends w, d (m, 2) on each of the `lines` (k,); -inf on lines without any."""
    left = np.argmin(w, axis=1)[:, None]
    w0, w1 = np.take_along_axis(w, left, axis=1), np.take_along_axis(w, 1 - left, axis=1)
    d0, d1 = np.take_along_axis(d, left, axis=1), np.take_along_axis(d, 1 - left, axis=1)
    at = d0 + (d1 - d0) * (lines - w0) / np.where(w1 > w0, w1 - w0, 1.0)
    return np.asarray(np.where((w0 <= lines) & (lines <= w1), at, -np.inf).max(axis=0))
