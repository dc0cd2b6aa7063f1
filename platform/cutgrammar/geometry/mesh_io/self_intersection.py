"""Does a mesh run into itself? Triangle against triangle, by separating axes.

Two triangles overlap if no axis tells them apart to within a tolerance: whoever wanted to part them had to move one of
them by more than that, whichever way. Triangles that merely touch (neighbours in an edge or a corner, a corner lying in
another triangle) can be parted for nothing, so neighbours need no special case and are found where they truly fold over
each other. For triangles in one plane the axes in that plane decide.

Not found: surfaces that cross exactly along edges of both, without sharing corners there.
"""

import numba
import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh

TOLERANCE = 1e-9
"""Depth that counts as touching, as a share of the mesh's largest extent."""


def self_intersections(mesh: Mesh, most: int = 1) -> Ints:
    """(k, 2) pairs of faces that overlap, the first `most` found; none for a mesh that does not run into itself.

    Boxes are compared by a sweep along the axis that tells them apart best.
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
        most,
    )
    return np.asarray(np.sort(order[pairs], axis=1))


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _sweep(triangles: Floats, lowest: Floats, highest: Floats, tolerance: float, most: int) -> Ints:
    """Pairs of overlapping triangles (m, 3, 3), whose boxes come sorted by their lowest first coordinate."""
    found = np.empty((most, 2), dtype=np.int64)
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
                if count == most:
                    return found
    return found[:count]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _overlap(p: Floats, q: Floats, tolerance: float) -> bool:
    """No axis tells the triangles p and q (3, 3) apart to within `tolerance`."""
    np_ = _cross(p[1] - p[0], p[2] - p[0])
    nq_ = _cross(q[1] - q[0], q[2] - q[0])
    if _flat_on(np_, p, q, tolerance) and _flat_on(nq_, q, p, tolerance):
        for i in range(3):
            if _apart(_cross(np_, p[(i + 1) % 3] - p[i]), p, q, tolerance):
                return False
            if _apart(_cross(nq_, q[(i + 1) % 3] - q[i]), p, q, tolerance):
                return False
        return True
    if _apart(np_, p, q, tolerance) or _apart(nq_, p, q, tolerance):
        return False
    for i in range(3):
        for j in range(3):
            if _apart(_cross(p[(i + 1) % 3] - p[i], q[(j + 1) % 3] - q[j]), p, q, tolerance):
                return False
    return True


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _cross(a: Floats, b: Floats) -> Floats:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _dot(a: Floats, b: Floats) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _flat_on(normal: Floats, p: Floats, q: Floats, tolerance: float) -> bool:
    """All corners of q lie within `tolerance` of the plane of p."""
    limit = tolerance * np.sqrt(_dot(normal, normal))
    for i in range(3):
        if abs(_dot(normal, q[i] - p[0])) > limit:
            return False
    return bool(limit > 0.0)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _apart(axis: Floats, p: Floats, q: Floats, tolerance: float) -> bool:
    """Moving p along `axis` (of any length), one way or the other, by `tolerance` parts it from q."""
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
