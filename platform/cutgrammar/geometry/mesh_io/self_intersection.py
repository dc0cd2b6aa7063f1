"""Detection of self-intersections of a mesh: triangle against triangle, by separating axes.

Two triangles overlap if no axis separates them to within a tolerance, that is, if separating them takes a translation
of more than the tolerance in any direction. Triangles that only touch (neighbours at an edge or a vertex, a vertex on
another triangle) are separated by an arbitrarily small translation. Neighbours therefore need no special case and are
found only if they fold over each other. For coplanar triangles the axes within their plane are used.

Surfaces that cross exactly along edges of both without sharing vertices are not detected.
"""

import numba
import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh

TOLERANCE = 1e-9
"""Maximum overlap of triangles that only touch, as a share of the mesh's largest extent."""


def self_intersections(mesh: Mesh, max_pairs: int = 1) -> Ints:
    """(k, 2) index pairs of faces that overlap, at most `max_pairs`; empty if the mesh does not intersect itself.

    Candidates are found by sweeping the triangles' bounding boxes along the axis that separates them best.
    """
    triangles = mesh.triangles
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    lowest, highest = triangles.min(axis=1), triangles.max(axis=1)
    extent = highest.max(axis=0) - lowest.min(axis=0)
    widths = (highest - lowest).mean(axis=0) / np.maximum(extent, 1e-300)
    first = int(np.argmin(np.where(extent > 0, widths, np.inf)))
    axes = np.roll(np.arange(3), -first)
    order = np.argsort(lowest[:, first], kind="stable")
    pairs = _sweep(
        np.ascontiguousarray(triangles[order]),
        np.ascontiguousarray(lowest[order][:, axes]),
        np.ascontiguousarray(highest[order][:, axes]),
        TOLERANCE * float(extent.max()),
        max_pairs,
    )
    return np.asarray(np.sort(order[pairs], axis=1))


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _sweep(triangles: Floats, lowest: Floats, highest: Floats, tolerance: float, max_pairs: int) -> Ints:
    """Pairs of overlapping triangles (m, 3, 3), which are sorted by the lower bound of their first coordinate."""
    found = np.empty((max_pairs, 2), dtype=np.int64)
    count = 0
    for i in range(len(triangles)):
        for j in range(i + 1, len(triangles)):
            if lowest[j, 0] > highest[i, 0]:
                break
            if lowest[j, 1] > highest[i, 1] or lowest[i, 1] > highest[j, 1]:
                continue
            if lowest[j, 2] > highest[i, 2] or lowest[i, 2] > highest[j, 2]:
                continue
            if _overlap(triangles[i], triangles[j], tolerance):
                found[count, 0], found[count, 1] = i, j
                count += 1
                if count == max_pairs:
                    return found
    return found[:count]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _overlap(p: Floats, q: Floats, tolerance: float) -> bool:
    """Whether no axis separates the triangles p and q (3, 3) to within `tolerance`."""
    normal_p = _cross(p[1] - p[0], p[2] - p[0])
    normal_q = _cross(q[1] - q[0], q[2] - q[0])
    if _coplanar(normal_p, p, q, tolerance) and _coplanar(normal_q, q, p, tolerance):
        for i in range(3):
            if _separates(_cross(normal_p, p[(i + 1) % 3] - p[i]), p, q, tolerance):
                return False
            if _separates(_cross(normal_q, q[(i + 1) % 3] - q[i]), p, q, tolerance):
                return False
        return True
    if _separates(normal_p, p, q, tolerance) or _separates(normal_q, p, q, tolerance):
        return False
    for i in range(3):
        for j in range(3):
            if _separates(_cross(p[(i + 1) % 3] - p[i], q[(j + 1) % 3] - q[j]), p, q, tolerance):
                return False
    return True


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _cross(a: Floats, b: Floats) -> Floats:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _dot(a: Floats, b: Floats) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _coplanar(normal: Floats, p: Floats, q: Floats, tolerance: float) -> bool:
    """Whether all corners of q are within `tolerance` of the plane of p."""
    limit = tolerance * np.sqrt(_dot(normal, normal))
    for i in range(3):
        if abs(_dot(normal, q[i] - p[0])) > limit:
            return False
    return bool(limit > 0.0)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _separates(axis: Floats, p: Floats, q: Floats, tolerance: float) -> bool:
    """Whether a translation of p by `tolerance` in either direction of `axis` (of any length) separates it from q."""
    length = np.sqrt(_dot(axis, axis))
    if length <= 0.0:
        return False
    low_p = low_q = np.inf
    high_p = high_q = -np.inf
    for i in range(3):
        at_p, at_q = _dot(axis, p[i] - p[0]), _dot(axis, q[i] - p[0])
        low_p, high_p = min(low_p, at_p), max(high_p, at_p)
        low_q, high_q = min(low_q, at_q), max(high_q, at_q)
    return bool(min(high_p - low_q, high_q - low_p) <= tolerance * length)
