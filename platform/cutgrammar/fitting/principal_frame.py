"""The principal frame of sample points, as `canonical_frame` defines it for solids, for compiled code."""

import numpy as np
from numba import njit

EXACT = 1e-14
"""Axes are found when the squared covariances along different ones are this share of the squared total variance."""


@njit(cache=True, fastmath=True)
def moments(points, first, last, centre, covariance):  # type: ignore[no-untyped-def]
    """Write centroid (3,) and covariance (3, 3) of points[first:last] (n, 3) into `centre` and `covariance`."""
    n = last - first
    # Sums about one of the points, which is near enough to the centroid for their differences to be exact.
    px, py, pz = np.float64(points[first, 0]), np.float64(points[first, 1]), np.float64(points[first, 2])
    x = y = z = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(first, last):
        p = np.uint64(i)
        a, b, c = np.float64(points[p, 0]) - px, np.float64(points[p, 1]) - py, np.float64(points[p, 2]) - pz
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
    m = covariance
    m[0, 0], m[1, 1], m[2, 2] = xx / n - x * x, yy / n - y * y, zz / n - z * z
    m[0, 1] = m[1, 0] = xy / n - x * y
    m[0, 2] = m[2, 0] = xz / n - x * z
    m[1, 2] = m[2, 1] = yz / n - y * z


@njit(cache=True)
def principal_deviations(m, deviations):  # type: ignore[no-untyped-def]
    """Write the roots (3,) of the eigenvalues of a covariance (3, 3), ascending, into `deviations`, in closed form."""
    mean = (m[0, 0] + m[1, 1] + m[2, 2]) / 3.0
    a, b, c = m[0, 0] - mean, m[1, 1] - mean, m[2, 2] - mean
    d, e, f = m[0, 1], m[0, 2], m[1, 2]
    scale = np.sqrt((a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)) / 6.0)
    smallest = largest = mean
    if scale > 1e-12 * mean:
        determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
        angle = np.arccos(min(max(0.5 * determinant / scale**3, -1.0), 1.0)) / 3.0
        largest = mean + 2.0 * scale * np.cos(angle)
        smallest = mean + 2.0 * scale * np.cos(angle + 2.0 * np.pi / 3.0)
    deviations[0] = np.sqrt(max(smallest, 0.0))
    deviations[1] = np.sqrt(max(3.0 * mean - smallest - largest, 0.0))
    deviations[2] = np.sqrt(max(largest, 0.0))


@njit(cache=True)
def principal_axes(covariance, axes):  # type: ignore[no-untyped-def]
    """Write the principal axes of a covariance (3, 3) into the columns of `axes` (3, 3).

    They have ascending variances and are right-handed, as in `canonical_frame`; their signs are arbitrary. Found by
    Jacobi rotations.
    """
    m = covariance.copy()
    for i in range(3):
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
    for _ in range(8):
        off = m[0, 1] ** 2 + m[0, 2] ** 2 + m[1, 2] ** 2
        if off <= EXACT * (m[0, 0] + m[1, 1] + m[2, 2]) ** 2:
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
    for a, b in ((0, 1), (1, 2), (0, 1)):
        if m[a, a] > m[b, b]:
            m[a, a], m[b, b] = m[b, b], m[a, a]
            for k in range(3):
                axes[k, a], axes[k, b] = axes[k, b], axes[k, a]
    axes[0, 1] = axes[1, 2] * axes[2, 0] - axes[2, 2] * axes[1, 0]
    axes[1, 1] = axes[2, 2] * axes[0, 0] - axes[0, 2] * axes[2, 0]
    axes[2, 1] = axes[0, 2] * axes[1, 0] - axes[1, 2] * axes[0, 0]
