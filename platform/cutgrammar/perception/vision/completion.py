"""From what cameras see of one fragment, its top and some sides, to a closed mesh (IV-D).

The underside and touching faces are never seen. The fragment is taken to be convex and to lie on the board: its points
are smoothed, each one stands for a point of the underside below it, halfway between the board and its mirror image in
the middle height, and the convex hull of both is the fragment. The board alone would give every round food a square
bottom, the mirror image every half of one a round one; halfway has the smallest error of z and volume of the three
(docs/cameras.md). Where cameras have seen the underside nothing is added.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.perception.vision.neighbourhoods import thin

MIRRORED = 0.5
"""Where the underside is taken to be: 0 on the board, 1 the mirror image of the top."""
CELL = 3e-3
"""Side of the cells in which points are thinned [m]."""
NEIGHBOURS, REACH = 16, 5e-3
"""Points are moved onto the mean plane of so many neighbours, no farther away than this [m]."""
FEWEST = 12
"""Smoothed points below which nothing can be said of a fragment."""
DOWN, UNDERSIDE = -0.85, 0.05
"""A normal below this height points down; with this share of such points the underside has been seen."""
ON_BOARD = 0.6
"""A fragment whose lowest point seen is below this share of its height lies on the board; else on another."""


def complete(points_W: Floats, normals_W: Floats, mirrored: float = MIRRORED) -> Mesh | None:
    """The closed mesh in W of a fragment seen in part; None where too little is seen of it.

    Args:
        points_W: (n, 3) its points in W, whose z = 0 is the board's top [m].
        normals_W: (n, 3) their outward unit normals.
        mirrored: where the underside is taken to be, as `MIRRORED`.
    """
    if len(points_W) < FEWEST:
        return None
    points, normals = _smoothed(points_W, normals_W)
    if len(points) < FEWEST:
        return None
    if np.mean(normals[:, 2] < DOWN) < UNDERSIDE:
        points = np.concatenate([points, _underside(points, mirrored)])
    return hull(points)


def hull(points: Floats) -> Mesh | None:
    """The convex hull of points (n, 3) as a closed mesh; None where they lie in a plane."""
    try:
        found = ConvexHull(points)
    except QhullError:
        return None
    corners = points[found.simplices]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = found.simplices.astype(np.int64)
    turned = np.einsum("ij,ij->i", outward, found.equations[:, :3]) < 0.0
    faces[turned] = faces[turned][:, ::-1]
    used = np.unique(faces)
    number = np.zeros(len(points), dtype=np.int64)
    number[used] = np.arange(len(used))
    mesh = Mesh(points[used], number[faces])
    return mesh if mesh.volume > 0.0 else None


def _smoothed(points: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Fewer points, moved onto the mean planes of their neighbours; what floats alone is left out."""
    few = thin(points, normals, CELL)
    distances, neighbours = cKDTree(points).query(few.points, k=min(NEIGHBOURS, len(points)))
    near = (distances <= REACH).astype(np.float64)
    count = near.sum(axis=1)
    middle = np.einsum("nkj,nk->nj", points[neighbours], near) / np.maximum(count, 1.0)[:, None]
    normal = np.einsum("nkj,nk->nj", normals[neighbours], near)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    off = np.einsum("nj,nj->n", few.points - middle, normal)
    kept = count >= 5
    return (few.points - off[:, None] * normal)[kept], normal[kept]


def _underside(points: Floats, mirrored: float) -> Floats:
    """(n, 3) where the underside is taken to be below each of the points (n, 3)."""
    lowest, highest = points[:, 2].min(), points[:, 2].max()
    floor = 0.0 if lowest < ON_BOARD * highest else lowest
    under = points.copy()
    under[:, 2] = floor + mirrored * (highest - points[:, 2])
    return under[under[:, 2] < points[:, 2]]
