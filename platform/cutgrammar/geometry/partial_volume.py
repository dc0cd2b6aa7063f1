"""The part of a solid on one side of a plane, without slicing its mesh: volume, moments and the plane for a volume.

By the divergence theorem, the volume of a solid below the plane z = h is minus the sum over its triangles of the
integral of max(h - z, 0) over the triangle's signed projection along z. For one triangle that integral is a cubic of h
between its corners, so it is exact. Moments of the part below follow from the tetrahedra between its clipped triangles
and a point of the plane: the section itself adds nothing, because it lies in the plane of that point.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats

BISECTIONS = 40
"""Number of bisections that find a plane; the extent is divided by 2 to this power."""


@dataclass(frozen=True, eq=False)
class Part:
    """The part of a solid below a plane.

    Attributes:
        volume: its volume [m3].
        extents: (3,) its extents along its own principal axes, smallest variance first [m].
    """

    volume: float
    extents: Floats


def volume_below(triangles: Floats, axis: int, height: float) -> float:
    """Volume of a closed mesh where the coordinate `axis` is less than `height` [m3].

    Args:
        triangles: (m, 3, 3) corners of the triangles, counter-clockwise seen from outside [m].
        axis: 0, 1 or 2 for x, y or z.
        height: of the plane along the axis [m].
    """
    return float(_volume_below(np.ascontiguousarray(triangles), axis, height))


def height_of_volume(triangles: Floats, axis: int, volume: float) -> float:
    """The height below which a closed mesh has `volume` [m3] along `axis`; see `volume_below` for the arguments."""
    return float(_height_of_volume(np.ascontiguousarray(triangles), axis, volume))


def part_below(triangles: Floats, axis: int, height: float) -> Part | None:
    """The part of a closed mesh below `height` along `axis`; None if it has no volume.

    The arguments are those of `volume_below`. Parts that are not connected count as one.
    """
    volume, covariance, points = _part_below(np.ascontiguousarray(triangles), axis, height)
    if volume <= 0.0 or len(points) == 0:
        return None
    axes = np.linalg.eigh(covariance).eigenvectors
    return Part(float(volume), np.asarray(np.ptp(points @ axes, axis=0)))


@njit(cache=True)
def _volume_below(triangles, axis, height):  # type: ignore[no-untyped-def]
    u, v = (axis + 1) % 3, (axis + 2) % 3
    total = 0.0
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        area = ((b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u])) / 2.0
        low, high = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
        middle = a[axis] + b[axis] + c[axis] - low - high
        if height >= high:
            depth = height - (low + middle + high) / 3.0
        elif height <= low:
            continue
        elif height <= middle:
            depth = (height - low) ** 3 / (3.0 * (middle - low) * (high - low))
        else:
            over = (high - height) ** 3 / (3.0 * (high - low) * (high - middle))
            depth = height - (low + middle + high) / 3.0 + over
        total -= area * depth
    return total


@njit(cache=True)
def _height_of_volume(triangles, axis, volume):  # type: ignore[no-untyped-def]
    low, high = triangles[:, :, axis].min(), triangles[:, :, axis].max()
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        if _volume_below(triangles, axis, middle) < volume:
            low = middle
        else:
            high = middle
    return (low + high) / 2.0


@njit(cache=True)
def _part_below(triangles, axis, height):  # type: ignore[no-untyped-def]
    """Volume, covariance (3, 3) and corners (n, 3) of the part below; the corners of clipped triangles repeat."""
    points = np.empty((4 * len(triangles), 3))
    n_points = 0
    origin = np.array([triangles[:, :, d].mean() for d in range(3)])
    origin[axis] = height
    volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    corners = np.empty((4, 3))
    for t in range(len(triangles)):
        n = 0
        for i in range(3):
            p, q = triangles[t, i], triangles[t, (i + 1) % 3]
            if p[axis] <= height:
                corners[n] = p
                n += 1
            if (p[axis] < height < q[axis]) or (q[axis] < height < p[axis]):
                share = (height - p[axis]) / (q[axis] - p[axis])
                corners[n] = p + share * (q - p)
                corners[n, axis] = height
                n += 1
        if n < 3:
            continue
        for i in range(n):
            points[n_points] = corners[i]
            n_points += 1
        for i in range(1, n - 1):
            a, b, c = corners[0] - origin, corners[i] - origin, corners[i + 1] - origin
            six = (
                a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
            )
            total = a + b + c
            volume += six / 6.0
            first += six / 24.0 * total
            for j in range(3):
                for k in range(3):
                    second[j, k] += six / 120.0 * (a[j] * a[k] + b[j] * b[k] + c[j] * c[k] + total[j] * total[k])
    if volume > 0.0:
        mean = first / volume
        for j in range(3):
            for k in range(3):
                second[j, k] = second[j, k] / volume - mean[j] * mean[k]
    return volume, second, points[:n_points]
