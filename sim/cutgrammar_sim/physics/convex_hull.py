"""The convex hull of a fragment's mesh: its corners, triangles and planes, and points all over its surface."""

from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Fragment, Mesh

SPACING = 8e-3
"""Distance between neighbouring points of `surface_points` [m]."""
CACHED = 96
"""Meshes whose hulls are cached: somewhat more than lie on a board at once."""


@lru_cache(maxsize=CACHED)
def hull_of(mesh: Mesh) -> tuple[Floats, Ints, Floats]:
    """The convex hull of a mesh in F: (k, 3) corners, (m, 3) triangles of them, (m, 4) outward planes n.v + d <= 0."""
    hull = ConvexHull(mesh.vertices)
    number = np.zeros(len(mesh.vertices), dtype=np.int64)
    number[hull.vertices] = np.arange(len(hull.vertices))
    return np.asarray(mesh.vertices[hull.vertices]), number[hull.simplices], np.asarray(hull.equations)


def hull_corners(fragment: Fragment) -> Floats:
    """(k, 3) corners of the convex hull of a fragment, in W [m]."""
    return fragment.X_WF.apply(hull_of(fragment.mesh)[0])


@lru_cache(maxsize=CACHED)
def surface_points(mesh: Mesh) -> Floats:
    """(k, 3) points in F on the convex hull of a mesh, about `SPACING` apart, its corners among them [m]."""
    corners, triangles, _ = hull_of(mesh)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    longest = np.max([np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], 0)
    parts = np.ceil(longest / SPACING).astype(int)
    points = [corners]
    for n in np.unique(parts[parts > 1]):
        i, j = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T / n
        some = parts == n
        inner = a[some][:, None] + i[:, None] * (b[some] - a[some])[:, None] + j[:, None] * (c[some] - a[some])[:, None]
        points.append(inner.reshape(-1, 3))
    found = np.concatenate(points)
    _, first = np.unique(np.round(found / (SPACING / 3)), axis=0, return_index=True)  # drops near duplicates
    return np.concatenate([corners, found[np.sort(first[first >= len(corners)])]])
