"""IoU of sample points with a target, as the score computes it: canonical frames aligned, best of four flips."""

import numpy as np
from numba import njit

from cutgrammar.fitting.targets import HALF, SIDE, STEEPNESS

FEW = 4
"""Fewer points than this have no canonical frame and count as an IoU of 0."""
FLIPPED = 40
"""About as many points choose the two flips that are compared fully, where there are many more."""
WHOLE_RANGE = 2.0**32
MARGIN = 0.08
"""An IoU hardly ever exceeds `box_overlap` by more: by less in 99 % of 4,400 pairs of terminals and fragments."""


@njit(cache=True)
def box_overlap(deviations, others):  # type: ignore[no-untyped-def]
    """IoU of two boxes with these standard deviations (3,), (3,), sides parallel and centres equal.

    It predicts the IoU of two fragments in canonical frames from their second moments, and is an upper bound but for
    `MARGIN`.
    """
    one = other = shared = 1.0
    for axis in range(3):
        one *= deviations[axis]
        other *= others[axis]
        shared *= min(deviations[axis], others[axis])
    return shared / max(one + other - shared, 1e-300)


@njit(cache=True)
def virtual_iou(  # type: ignore[no-untyped-def]
    points, keys, first, last, centre, frame, weight, grid, cell, volume, chosen, local, compared
):
    """IoU of points[first:last] with one target, up to sampling; it does not depend on the order of the points.

    Args:
        points: (n, 3) sample points in any frame [m].
        keys: (n,) random 32-bit keys; of many points those with the lowest keys are compared.
        first, last: range of the points of the terminal.
        centre, frame: (3,), (3, 3) their centroid and principal axes.
        weight: volume that each point stands for [m3].
        grid, cell, volume: of the target.
        chosen, local: (n,), (2, 3, n) scratch memory.
        compared: about as many points are compared with the target.
    """
    n = last - first
    m = n
    if n > compared:
        m = _lowest(keys, first, last, np.uint32(WHOLE_RANGE * (compared / n)), chosen)
    else:
        for i in range(n):
            chosen[i] = first + i
    if m == 0:
        return 0.0
    _transform(points, chosen, m, centre, frame, cell, local[0])
    best = np.float32(0.0)
    if m <= 3 * FLIPPED:
        for flip in range(4):
            best = max(best, _inside(grid, local[0], m, flip))
    else:
        few = _lowest(keys, first, last, np.uint32(WHOLE_RANGE * (FLIPPED / n)), chosen)
        _transform(points, chosen, few, centre, frame, cell, local[1])
        highest = second = np.float32(-1.0)
        flip, other = 0, 0
        for f in range(4):
            total = _inside(grid, local[1], few, f)
            if total > highest:
                second, other = highest, flip
                highest, flip = total, f
            elif total > second:
                second, other = total, f
        best = max(_inside(grid, local[0], m, flip), _inside(grid, local[0], m, other))
    shared = min(best * weight * n / m, volume, n * weight)
    return shared / (n * weight + volume - shared)


@njit(cache=True)
def _lowest(keys, first, last, limit, chosen):  # type: ignore[no-untyped-def]
    """Write the indices of the keys up to a limit into `chosen`; return their number."""
    m = 0
    for i in range(first, last):
        chosen[m] = i
        m += keys[np.uint64(i)] <= limit
    return m


@njit(cache=True, fastmath=True)
def _transform(points, chosen, m, centre, frame, cell, local):  # type: ignore[no-untyped-def]
    """Write the coordinates of the first m chosen points in the terminal's frame into `local` (3, n), in cells."""
    for axis in range(3):
        a, b, c = frame[0, axis] / cell[axis], frame[1, axis] / cell[axis], frame[2, axis] / cell[axis]
        d = a * centre[0] + b * centre[1] + c * centre[2]
        for p in range(m):
            i = np.uint64(chosen[p])
            local[axis, p] = a * points[i, 0] + b * points[i, 1] + c * points[i, 2] - d


@njit(cache=True, fastmath=True)
def _inside(grid, local, n, flip):  # type: ignore[no-untyped-def]
    """Sum of the occupancies of the first n points of `local` under one of the four flips, from 0 to 1 each.

    No branch depends on a point: those outside are moved into the empty layer of the grid. With single precision all
    through, the loop becomes vector instructions.
    """
    half, none, one, steep = np.float32(0.5), np.float32(0.0), np.float32(1.0), np.float32(STEEPNESS)
    sx = one if flip < 2 else -one
    sy = one if flip % 2 == 0 else -one
    sz = sx * sy
    middle, high = np.float32(HALF + 0.5), np.float32(2 * HALF + 0.999)
    xs, ys, zs, shares = local[0], local[1], local[2], grid.reshape(-1)
    total = none
    for p in range(n):
        x = min(max(sx * xs[p] + middle, none), high)
        y = min(max(sy * ys[p] + middle, none), high)
        z = min(max(sz * zs[p] + middle, none), high)
        i, j, k = np.int32(x), np.int32(y), np.int32(z)
        u, v, w = x - np.float32(i), y - np.float32(j), z - np.float32(k)
        at = np.int32((i * SIDE + j) * SIDE + k)
        a = shares[at] + w * (shares[at + 1] - shares[at])
        at += np.int32(SIDE)
        b = shares[at] + w * (shares[at + 1] - shares[at])
        at += np.int32(SIDE * (SIDE - 1))
        c = shares[at] + w * (shares[at + 1] - shares[at])
        at += np.int32(SIDE)
        d = shares[at] + w * (shares[at + 1] - shares[at])
        a += v * (b - a)
        c += v * (d - c)
        total += min(max(half + steep * (a + u * (c - a) - half), none), one)
    return total
