"""Evenly spread points inside a shape: what virtual cutting divides instead of meshes.

The points are those of a low-discrepancy sequence in the canonical bounding box of a mesh that lie inside it. A cloud
is replaced by the convex hull of its points, as in `Cloud.volume`. Each point stands for an equal share of the volume.
A point is inside a mesh if a ray along z crosses the surface an odd number of times. Which triangles a ray can meet is
looked up in columns along z.
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.perception.vision.convex_parts import hull

GENERATOR = 1.22074408460575947536
"""Real root of x^4 = x + 1; its inverse powers generate an additive low-discrepancy sequence in three dimensions."""
COLUMNS = 32
"""Columns along z on each side of the bounding box."""
MAX_TRIES = 60
"""Points tried for each point wanted: a shape that fills less than 1/60 of its box gets fewer points."""


def solid_of_shape(shape: Mesh | Cloud) -> Mesh:
    """The mesh itself, or the convex hull of a cloud, in the fragment's frame F.

    Raises:
        ValueError: the points of a cloud lie in a plane.
    """
    if isinstance(shape, Mesh):
        return shape
    solid = hull(shape.points)
    if solid is None:
        raise ValueError("the points of a cloud lie in a plane and enclose no volume")
    return solid


def interior_points(solid: Mesh, count: int, X_FC: Pose) -> Floats:
    """(n, 3) points evenly spread inside a solid, in its canonical frame C [m]; a pure function of the solid.

    Args:
        solid: a closed mesh.
        count: number of points wanted; fewer only if the solid fills hardly any of its bounding box.
        X_FC: its canonical frame.

    Raises:
        ValueError: no point lies inside.
    """
    points = _inside(np.ascontiguousarray(solid.moved(X_FC.inverse()).triangles), count, count * MAX_TRIES)
    if not len(points):
        raise ValueError(f"none of {count * MAX_TRIES} points lies inside the solid, which has no volume")
    return np.asarray(points)


@njit(cache=True)
def _inside(triangles, count, tries):  # type: ignore[no-untyped-def]
    """The first `count` points of the sequence in the bounding box of `triangles` (m, 3, 3) that lie inside."""
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        low[axis], high[axis] = triangles[:, :, axis].min(), triangles[:, :, axis].max()
    starts, members = _columns(triangles, low, high)
    found = np.empty((count, 3))
    n = 0
    point = np.empty(3)
    for i in range(1, tries + 1):
        for axis in range(3):
            share = (0.5 + i * GENERATOR ** -(axis + 1.0)) % 1.0
            point[axis] = low[axis] + share * (high[axis] - low[axis])
        column = _column(point[0], low[0], high[0]) * COLUMNS + _column(point[1], low[1], high[1])
        if _crossings_above(triangles, members[starts[column] : starts[column + 1]], point) % 2 == 1:
            found[n] = point
            n += 1
            if n == count:
                break
    return found[:n].copy()


@njit(cache=True)
def _column(at, low, high):  # type: ignore[no-untyped-def]
    """Number of the column along one axis."""
    return min(max(int((at - low) / max(high - low, 1e-300) * COLUMNS), 0), COLUMNS - 1)


@njit(cache=True)
def _columns(triangles, low, high):  # type: ignore[no-untyped-def]
    """The triangles whose bounding boxes meet each column: those of column c are members[starts[c] : starts[c + 1]]."""
    ranges = np.empty((len(triangles), 4), np.int64)
    starts = np.zeros(COLUMNS**2 + 1, np.int64)
    for t in range(len(triangles)):
        for axis in range(2):
            corners = triangles[t, :, axis]
            ranges[t, 2 * axis] = _column(corners.min(), low[axis], high[axis])
            ranges[t, 2 * axis + 1] = _column(corners.max(), low[axis], high[axis])
        for i in range(ranges[t, 0], ranges[t, 1] + 1):
            for j in range(ranges[t, 2], ranges[t, 3] + 1):
                starts[i * COLUMNS + j + 1] += 1
    for c in range(COLUMNS**2):
        starts[c + 1] += starts[c]
    members = np.empty(starts[-1], np.int64)
    free = starts.copy()
    for t in range(len(triangles)):
        for i in range(ranges[t, 0], ranges[t, 1] + 1):
            for j in range(ranges[t, 2], ranges[t, 3] + 1):
                members[free[i * COLUMNS + j]] = t
                free[i * COLUMNS + j] += 1
    return starts, members


@njit(cache=True)
def _crossings_above(triangles, near, point):  # type: ignore[no-untyped-def]
    """Number of the triangles `near` (indices) that the ray from `point` along +z crosses."""
    crossings = 0
    x, y = point[0], point[1]
    for t in near:
        ax, ay = triangles[t, 0, 0] - x, triangles[t, 0, 1] - y
        bx, by = triangles[t, 1, 0] - x, triangles[t, 1, 1] - y
        cx, cy = triangles[t, 2, 0] - x, triangles[t, 2, 1] - y
        if (ax < 0.0 and bx < 0.0 and cx < 0.0) or (ax > 0.0 and bx > 0.0 and cx > 0.0):
            continue
        if (ay < 0.0 and by < 0.0 and cy < 0.0) or (ay > 0.0 and by > 0.0 and cy > 0.0):
            continue
        u, v, w = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
        if not ((u >= 0.0 and v >= 0.0 and w >= 0.0) or (u < 0.0 and v < 0.0 and w < 0.0)):
            continue
        total = u + v + w
        if total == 0.0:
            continue
        if (u * triangles[t, 0, 2] + v * triangles[t, 1, 2] + w * triangles[t, 2, 2]) / total > point[2]:
            crossings += 1
    return crossings
