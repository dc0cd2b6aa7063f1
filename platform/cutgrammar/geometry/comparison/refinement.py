"""IoU after refining the rotation, for fragments whose principal axes are ill-defined.

The centroids stay aligned; only the rotation is optimised, by compass search (Hooke and Jeeves without pattern moves;
Kolda, Lewis and Torczon 2003) from each of the four proper sign choices. The search maximises an approximation of the
shared volume: the volume of one solid in the cells of a grid, weighted with the fill ratio of the other solid at the
cells' centres. The exact IoU is computed only for the best rotation.
"""

from functools import lru_cache

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.comparison.overlap import Solid

HALF = 6
"""Number of cells on either side of zero in a solid's grid; the outermost ones are empty."""
FIRST_STEP, LAST_STEP = np.radians(16.0), np.radians(0.5)
"""First and last step of the compass search [rad]; the step is halved when no direction improves."""
MIN_GAIN = 1e-9
"""Minimum relative increase of the approximate shared volume for a rotation to be accepted."""


def refined_iou(a: Solid, b: Solid, plain: float) -> float:
    """Exact intersection over union of two solids with aligned centroids, under the best rotation found.

    Args:
        a, b: the solids.
        plain: their IoU under the best of the four flips, a lower bound of the result.
    """
    points, weights = _points(a)
    sizes, fill = _fill_ratios(b)
    starts = np.array([flip.rotation for flip in FLIPS])
    rotation: Floats = _best_rotation(points, weights, sizes, fill, starts, FIRST_STEP, LAST_STEP)
    return max(plain, a.iou_with(b, rotation))


@lru_cache(maxsize=512)
def _fill_ratios(solid: Solid) -> tuple[Floats, Floats]:
    """Sizes (3,) of the cells of the solid's grid [m] and their fill ratios (c, c, c); cached for goals."""
    sizes = solid.half_extents / (HALF - 1)
    return sizes, cell_volumes(solid.mesh.triangles, sizes, HALF) / sizes.prod()


def _points(solid: Solid) -> tuple[Floats, Floats]:
    """Centres (p, 3) of the non-empty cells [m], and the share (p,) of the solid in each."""
    sizes, fill = _fill_ratios(solid)
    filled = np.argwhere(fill > 0.0)
    weights = fill[fill > 0.0]
    return (filled + 0.5 - HALF) * sizes, weights / weights.sum()


@njit(cache=True)
def _best_rotation(
    points: Floats, weights: Floats, sizes: Floats, fill: Floats, starts: Floats, first: float, last: float
) -> Floats:
    """The rotation (3, 3) of the second solid with the largest approximate shared volume over all starts."""
    best = -1.0
    best_rotation: Floats = starts[0].copy()
    for s in range(len(starts)):
        rotation = starts[s].copy()
        value = _shared(points, weights, sizes, fill, rotation)
        step = first
        while step >= last:
            better = False
            for axis in range(3):
                for sign in (-1.0, 1.0):
                    tried: Floats = _axis_rotation(axis, sign * step) @ rotation
                    tried_value = _shared(points, weights, sizes, fill, tried)
                    if tried_value > value * (1.0 + MIN_GAIN):
                        rotation, value, better = tried, tried_value, True
            if not better:
                step /= 2.0
        if value > best * (1.0 + MIN_GAIN):
            best, best_rotation = value, rotation
    return best_rotation


@njit(cache=True)
def _axis_rotation(axis: int, angle: float) -> Floats:
    """Rotation matrix (3, 3) about a coordinate axis."""
    rotation = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i] = rotation[j, j] = np.cos(angle)
    rotation[j, i] = np.sin(angle)
    rotation[i, j] = -rotation[j, i]
    return rotation


@njit(cache=True)
def _shared(points: Floats, weights: Floats, sizes: Floats, fill: Floats, rotation: Floats) -> float:
    """Share of the first solid inside the second, rotated by `rotation`; fill ratios are interpolated trilinearly."""
    n = fill.shape[0]
    total = 0.0
    for p in range(len(points)):
        # The transpose expresses the point in the frame of the rotated solid.
        x = (rotation[0, 0] * points[p, 0] + rotation[1, 0] * points[p, 1] + rotation[2, 0] * points[p, 2]) / sizes[0]
        y = (rotation[0, 1] * points[p, 0] + rotation[1, 1] * points[p, 1] + rotation[2, 1] * points[p, 2]) / sizes[1]
        z = (rotation[0, 2] * points[p, 0] + rotation[1, 2] * points[p, 1] + rotation[2, 2] * points[p, 2]) / sizes[2]
        x, y, z = x + (n - 1) / 2.0, y + (n - 1) / 2.0, z + (n - 1) / 2.0
        if x <= 0.0 or y <= 0.0 or z <= 0.0 or x >= n - 1 or y >= n - 1 or z >= n - 1:
            continue
        i, j, k = int(x), int(y), int(z)
        u, v, w = x - i, y - j, z - k
        low = (fill[i, j, k] * (1.0 - u) + fill[i + 1, j, k] * u) * (1.0 - v)
        low += (fill[i, j + 1, k] * (1.0 - u) + fill[i + 1, j + 1, k] * u) * v
        high = (fill[i, j, k + 1] * (1.0 - u) + fill[i + 1, j, k + 1] * u) * (1.0 - v)
        high += (fill[i, j + 1, k + 1] * (1.0 - u) + fill[i + 1, j + 1, k + 1] * u) * v
        total += weights[p] * (low * (1.0 - w) + high * w)
    return total
