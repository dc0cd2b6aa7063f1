"""Completion of one fragment: a closed mesh from the visible part of its surface, the top and some sides (IV-D).

The underside and touching faces are never visible. The fragment is assumed to lie on the board. Its points are
smoothed; for each of them, a point of the underside is added below, halfway between the board and the mirror image of
the point at half height; the fragment is the convex hull of all points, or the union of the hulls of its parts if it is
bent (`convex_parts`). Using the board alone would give round foods a flat bottom, and using the mirror image would give
their halves a round one; halfway has the smallest error in z and volume (docs/vision.md). Only whole objects, which are
round below, get the mirror image itself. Nothing is added if the underside has been observed.
"""

import numpy as np
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.perception.vision.convex_parts import closed_around
from cutgrammar.perception.vision.neighbourhoods import thin

MIRRORED, WHOLE = 0.5, 1.0
"""Assumed position of the underside of fragments, and of whole objects: 0 is on the board, 1 the mirror image of the
top."""
CELL = 3e-3
"""Side length of the grid cells for thinning [m]."""
N_NEIGHBOURS, RADIUS = 16, 5e-3
"""Points are projected onto the mean plane of at most this many neighbours within this radius [m]."""
MIN_POINTS = 12
"""Minimum number of points of a fragment that can be completed."""
DOWNWARD, UNDERSIDE = -0.85, 0.05
"""The underside counts as observed if this share of the normals has a z component below `DOWNWARD`."""
ON_BOARD = 0.6
"""A fragment lies on the board if its lowest point is below this share of its height; otherwise on another fragment."""


def complete(points_W: Floats, normals_W: Floats, mirrored: float = MIRRORED) -> Mesh | None:
    """The closed mesh in W of a partially observed fragment; None if there are too few points.

    Args:
        points_W: (n, 3) its observed points in W, where z = 0 is the top of the board [m].
        normals_W: (n, 3) their outward unit normals.
        mirrored: assumed position of the underside, see `MIRRORED`.
    """
    if len(points_W) < MIN_POINTS:
        return None
    points, normals = _smoothed(points_W, normals_W)
    if len(points) < MIN_POINTS:
        return None
    if np.mean(normals[:, 2] < DOWNWARD) < UNDERSIDE:
        return closed_around(points, _underside(points, mirrored))
    return closed_around(points)


def _smoothed(points: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Thinned points projected onto the mean planes of their neighbours; isolated points are removed."""
    few = thin(points, normals, CELL)
    distances, neighbours = cKDTree(points).query(few.points, k=min(N_NEIGHBOURS, len(points)))
    near = (distances <= RADIUS).astype(np.float64)
    count = near.sum(axis=1)
    middle = np.einsum("nkj,nk->nj", points[neighbours], near) / np.maximum(count, 1.0)[:, None]
    normal = np.einsum("nkj,nk->nj", normals[neighbours], near)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    off = np.einsum("nj,nj->n", few.points - middle, normal)
    kept = count >= 5
    return (few.points - off[:, None] * normal)[kept], normal[kept]


def _underside(points: Floats, mirrored: float) -> Floats:
    """Assumed points of the underside below points (n, 3)."""
    lowest, highest = points[:, 2].min(), points[:, 2].max()
    floor = 0.0 if lowest < ON_BOARD * highest else lowest
    under = points.copy()
    under[:, 2] = floor + mirrored * (highest - points[:, 2])
    return under[under[:, 2] < points[:, 2]]
