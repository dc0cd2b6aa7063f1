"""IoU of sample points with a target, as the score computes it: canonical frames aligned, best of four flips."""

import numpy as np
from numba import njit

from cutgrammar.fitting.targets import occupancy

FEW = 4
"""Fewer points than this have no canonical frame and count as an IoU of 0."""
COMPARED, FLIPPED = 160, 48
"""About as many points of a terminal are compared with its target, and to choose the flip; moments take all."""
WHOLE_RANGE = 2.0**64


@njit(cache=True)
def principal_frame(points, first, last, centre, axes):  # type: ignore[no-untyped-def]
    """Centroid and principal axes of points[first:last] (n, 3), into `centre` (3,) and the columns of `axes` (3, 3).

    The axes have ascending variances and are right-handed, as in `canonical_frame`; their signs are arbitrary. Returns
    the variances.
    """
    n = last - first
    x = y = z = 0.0
    for i in range(first, last):
        x += points[i, 0]
        y += points[i, 1]
        z += points[i, 2]
    x, y, z = x / n, y / n, z / n
    centre[0], centre[1], centre[2] = x, y, z
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(first, last):
        a, b, c = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        xx += a * a
        xy += a * b
        xz += a * c
        yy += b * b
        yz += b * c
        zz += c * c
    m = np.empty((3, 3))
    m[0, 0], m[1, 1], m[2, 2] = xx / n, yy / n, zz / n
    m[0, 1] = m[1, 0] = xy / n
    m[0, 2] = m[2, 0] = xz / n
    m[1, 2] = m[2, 1] = yz / n
    _diagonalise(m, axes)
    _ascending(m, axes)
    return m[0, 0], m[1, 1], m[2, 2]


@njit(cache=True)
def _diagonalise(m, axes):  # type: ignore[no-untyped-def]
    """Jacobi rotations of a symmetric matrix (3, 3), in place; the eigenvectors become the columns of `axes`."""
    for i in range(3):
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
    for _ in range(8):
        off = m[0, 1] ** 2 + m[0, 2] ** 2 + m[1, 2] ** 2
        if off <= 1e-20 * (m[0, 0] + m[1, 1] + m[2, 2]) ** 2:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if m[p, q] == 0.0:
                    continue
                theta = (m[q, q] - m[p, p]) / (2.0 * m[p, q])
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    a, b = m[k, p], m[k, q]
                    m[k, p], m[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = m[p, k], m[q, k]
                    m[p, k], m[q, k] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = axes[k, p], axes[k, q]
                    axes[k, p], axes[k, q] = c * a - s * b, s * a + c * b


@njit(cache=True)
def _ascending(m, axes):  # type: ignore[no-untyped-def]
    """Sort eigenvalues (on the diagonal) and columns ascending and make the axes right-handed."""
    for a, b in ((0, 1), (1, 2), (0, 1)):
        if m[a, a] > m[b, b]:
            m[a, a], m[b, b] = m[b, b], m[a, a]
            for k in range(3):
                axes[k, a], axes[k, b] = axes[k, b], axes[k, a]
    axes[0, 1] = axes[1, 2] * axes[2, 0] - axes[2, 2] * axes[1, 0]
    axes[1, 1] = axes[2, 2] * axes[0, 0] - axes[0, 2] * axes[2, 0]
    axes[2, 1] = axes[0, 2] * axes[1, 0] - axes[1, 2] * axes[0, 0]


@njit(cache=True)
def virtual_iou(points, keys, first, last, weight, grid, cell, volume, local):  # type: ignore[no-untyped-def]
    """IoU of points[first:last] with one target, up to sampling; it does not depend on the order of the points.

    Args:
        points: (n, 3) sample points in any frame [m].
        keys: (n,) random 64-bit keys; of many points those with the lowest keys are compared.
        first, last: range of the points of the terminal.
        weight: volume that each point stands for [m3].
        grid, cell, volume: of the target.
        local: (n, 3) scratch memory.
    """
    n = last - first
    if n < FEW:
        return 0.0
    centre, axes = np.empty(3), np.empty((3, 3))
    principal_frame(points, first, last, centre, axes)
    for a in range(3):
        for b in range(3):
            axes[a, b] /= cell[b]
    limit = np.uint64(WHOLE_RANGE * min(COMPARED / n, 0.9999999))
    thin = np.uint64(WHOLE_RANGE * min(FLIPPED / n, 0.9999999))
    m, t = 0, 0
    for i in range(first, last):
        if n > COMPARED and keys[i] > limit:
            continue
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        place = m
        if keys[i] <= thin:  # these come first
            place = t
            for axis in range(3):
                local[m, axis] = local[t, axis]
            t += 1
        local[place, 0] = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
        local[place, 1] = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
        local[place, 2] = x * axes[0, 2] + y * axes[1, 2] + z * axes[2, 2]
        m += 1
    if m == 0:
        return 0.0
    if t < FLIPPED // 2:
        t = m
    best, second = -1.0, -1.0
    flip, other = 0, 0
    for f in range(4):
        total = _inside(grid, local, t, f)
        if total > best:
            second, other = best, flip
            best, flip = total, f
        elif total > second:
            second, other = total, f
    if t < m:
        best = max(_inside(grid, local, m, flip), _inside(grid, local, m, other))
    shared = min(best * weight * n / m, volume, n * weight)
    return shared / (n * weight + volume - shared)


@njit(cache=True)
def _inside(grid, local, n, flip):  # type: ignore[no-untyped-def]
    """Sum of the occupancies of the first n points under one of the four flips."""
    sx = 1.0 if flip < 2 else -1.0
    sy = 1.0 if flip % 2 == 0 else -1.0
    sz = sx * sy
    total = 0.0
    for i in range(n):
        total += occupancy(grid, sx * local[i, 0], sy * local[i, 1], sz * local[i, 2])
    return total
