"""The principal frame of sample points, as `canonical_frame` defines it for solids, for compiled code."""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True)
def principal_frame(points, first, last, stride, centre, axes, deviations):  # type: ignore[no-untyped-def]
    """Centroid, principal axes and standard deviations along them of points[first:last:stride] (n, 3).

    They are written into `centre` (3,), the columns of `axes` (3, 3) and `deviations` (3,). The axes have ascending
    variances and are right-handed, as in `canonical_frame`; their signs are arbitrary.
    """
    n = (last - first + stride - 1) // stride
    # Moments about one of the points, which is near enough to the centroid for their differences to be exact.
    px, py, pz = points[first, 0], points[first, 1], points[first, 2]
    x = y = z = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(n):
        p = first + i * stride
        a, b, c = points[p, 0] - px, points[p, 1] - py, points[p, 2] - pz
        x += a
        y += b
        z += c
        xx += a * a
        xy += a * b
        xz += a * c
        yy += b * b
        yz += b * c
        zz += c * c
    x, y, z = x / n, y / n, z / n
    centre[0], centre[1], centre[2] = px + x, py + y, pz + z
    m = np.empty((3, 3))
    m[0, 0], m[1, 1], m[2, 2] = xx / n - x * x, yy / n - y * y, zz / n - z * z
    m[0, 1] = m[1, 0] = xy / n - x * y
    m[0, 2] = m[2, 0] = xz / n - x * z
    m[1, 2] = m[2, 1] = yz / n - y * z
    _diagonalise(m, axes)
    _ascending(m, axes)
    for axis in range(3):
        deviations[axis] = np.sqrt(max(m[axis, axis], 0.0))


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
