"""Compiled loops over the poses of a motion, which would take most of a recording's time with arrays as large."""

import math

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints


@njit(cache=True, nogil=True)
def relative(poses: Floats, frames: Floats) -> Floats:
    """(t, 7) X_OB from X_WB and X_WO, (t, 7) each: position [m] and quaternion w x y z, returned with w >= 0."""
    found = np.empty((len(poses), 7))
    for i in range(len(poses)):
        a, b, c, d = frames[i, 3], -frames[i, 4], -frames[i, 5], -frames[i, 6]
        w, x, y, z = poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6]
        size = a * a + b * b + c * c + d * d
        px, py, pz = poses[i, 0] - frames[i, 0], poses[i, 1] - frames[i, 1], poses[i, 2] - frames[i, 2]
        tx, ty, tz = 2.0 * (c * pz - d * py) / size, 2.0 * (d * px - b * pz) / size, 2.0 * (b * py - c * px) / size
        found[i, 0] = px + a * tx + c * tz - d * ty
        found[i, 1] = py + a * ty + d * tx - b * tz
        found[i, 2] = pz + a * tz + b * ty - c * tx
        scale = 1.0 / math.sqrt(size * (w * w + x * x + y * y + z * z))
        if a * w - b * x - c * y - d * z < 0.0:
            scale = -scale
        found[i, 3] = scale * (a * w - b * x - c * y - d * z)
        found[i, 4] = scale * (a * x + b * w + c * z - d * y)
        found[i, 5] = scale * (a * y - b * z + c * w + d * x)
        found[i, 6] = scale * (a * z + b * y - c * x + d * w)
    return found


@njit(cache=True, nogil=True)
def changed_rows(values: Floats, before: Floats, limit: float) -> Ints:
    """Indices of the rows of (t, n) that differ from the last one kept by more than `limit` in some number.

    Args:
        values: (t, n).
        before: (n,) the row that was kept before them; of (0,), the first row is kept.
        limit: greatest difference that counts as none.
    """
    kept = np.empty(len(values), dtype=np.int64)
    count = 0
    for i in range(len(values)):
        differs = count == 0 and len(before) == 0
        for j in range(values.shape[1]):
            last = values[kept[count - 1], j] if count else (before[j] if len(before) else 0.0)
            differs = differs or abs(values[i, j] - last) > limit
        if differs:
            kept[count] = i
            count += 1
    return kept[:count].copy()


@njit(cache=True, nogil=True)
def held_numbers(values: Floats, limit: float) -> Floats:
    """(t, n) with each number as it was until it has changed by more than `limit`, so that rounding takes no room."""
    found = values.copy()
    for j in range(values.shape[1]):
        for i in range(1, len(values)):
            if abs(found[i, j] - found[i - 1, j]) <= limit:
                found[i, j] = found[i - 1, j]
    return found
