"""IoU after the rotation is refined: where principal axes are noise, two like fragments need not lie alike in them.

The centroids stay on one another; only the rotation is sought, by compass search (the pattern search of Hooke and
Jeeves without its pattern moves; Kolda, Lewis and Torczon 2003) from each of the four proper choices of signs. It goes
by a stand-in for the shared volume: one solid's volume in the cells of a grid, weighted with how full the other is
where their middles come to lie. The exact IoU is taken of the best rotation found, and of no other.
"""

from functools import lru_cache

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.comparison.overlap import Solid

HALF = 6
"""Cells on either side of zero in a solid's grid; the outermost ones are empty."""
FIRST, LAST = np.radians(16.0), np.radians(0.5)
"""First and last step of the compass search [rad]; a step is halved where no direction is better."""
GAIN = 1e-9
"""A rotation is better if the stand-in grows by more than this share."""


def refined_iou(a: Solid, b: Solid, plain: float) -> float:
    """Intersection over union of two solids about their centroids, exact, in the best rotation found.

    Args:
        a, b: the solids.
        plain: their IoU in the best of the four flips; the result is never under it.
    """
    points, weights = _points(a)
    sizes, fullness = _picture(b)
    starts = np.array([flip.rotation for flip in FLIPS])
    turn: Floats = _best_turn(points, weights, sizes, fullness, starts, FIRST, LAST)
    return max(plain, a.iou_with(b, turn))


@lru_cache(maxsize=512)
def _picture(solid: Solid) -> tuple[Floats, Floats]:
    """Sizes (3,) of the cells of the solid's own grid [m], and how full they are (c, c, c); kept for goals."""
    sizes = solid.reach / (HALF - 1)
    return sizes, cell_volumes(solid.mesh.triangles, sizes, HALF) / sizes.prod()


def _points(solid: Solid) -> tuple[Floats, Floats]:
    """Middles (p, 3) of the cells that are not empty [m], and the share (p,) of the solid in each."""
    sizes, fullness = _picture(solid)
    filled = np.argwhere(fullness > 0.0)
    weights = fullness[fullness > 0.0]
    return (filled + 0.5 - HALF) * sizes, weights / weights.sum()


@njit(cache=True)
def _best_turn(
    points: Floats, weights: Floats, sizes: Floats, fullness: Floats, starts: Floats, first: float, last: float
) -> Floats:
    """The rotation (3, 3) of the second solid at which it shares most with the first, of those climbed to."""
    best = -1.0
    found: Floats = starts[0].copy()
    for s in range(len(starts)):
        turn = starts[s].copy()
        here = _shared(points, weights, sizes, fullness, turn)
        step = first
        while step >= last:
            better = False
            for axis in range(3):
                for sign in (-1.0, 1.0):
                    tried: Floats = _about(axis, sign * step) @ turn
                    there = _shared(points, weights, sizes, fullness, tried)
                    if there > here * (1.0 + GAIN):
                        turn, here, better = tried, there, True
            if not better:
                step /= 2.0
        if here > best * (1.0 + GAIN):
            best, found = here, turn
    return found


@njit(cache=True)
def _about(axis: int, angle: float) -> Floats:
    """The rotation (3, 3) about a coordinate axis."""
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i] = np.sin(angle)
    turn[i, j] = -turn[j, i]
    return turn


@njit(cache=True)
def _shared(points: Floats, weights: Floats, sizes: Floats, fullness: Floats, turn: Floats) -> float:
    """Share of the first solid within the second under `turn`, the fullness between cells' middles interpolated."""
    n = fullness.shape[0]
    total = 0.0
    for p in range(len(points)):
        # Rows of the transpose: a point seen from the turned solid.
        x = (turn[0, 0] * points[p, 0] + turn[1, 0] * points[p, 1] + turn[2, 0] * points[p, 2]) / sizes[0]
        y = (turn[0, 1] * points[p, 0] + turn[1, 1] * points[p, 1] + turn[2, 1] * points[p, 2]) / sizes[1]
        z = (turn[0, 2] * points[p, 0] + turn[1, 2] * points[p, 1] + turn[2, 2] * points[p, 2]) / sizes[2]
        x, y, z = x + (n - 1) / 2.0, y + (n - 1) / 2.0, z + (n - 1) / 2.0
        if x <= 0.0 or y <= 0.0 or z <= 0.0 or x >= n - 1 or y >= n - 1 or z >= n - 1:
            continue
        i, j, k = int(x), int(y), int(z)
        u, v, w = x - i, y - j, z - k
        low = (fullness[i, j, k] * (1.0 - u) + fullness[i + 1, j, k] * u) * (1.0 - v)
        low += (fullness[i, j + 1, k] * (1.0 - u) + fullness[i + 1, j + 1, k] * u) * v
        high = (fullness[i, j, k + 1] * (1.0 - u) + fullness[i + 1, j, k + 1] * u) * (1.0 - v)
        high += (fullness[i, j + 1, k + 1] * (1.0 - u) + fullness[i + 1, j + 1, k + 1] * u) * v
        total += weights[p] * (low * (1.0 - w) + high * w)
    return total
