"""What a fragment collides as: its convex hull, or the hulls of its parts, in pieces that PhysX can hold.

A fragment that fills its hull, as most do, collides as that. A banana does not: what fills less than nine tenths of its
hull is halved across its length again and again, until its parts nearly fill theirs.

PhysX holds at most 255 faces a hull and quietly drops what is beyond. So a hull of more than 128 corners is made of
several pieces, each the hull of some of its facets and its middle; beyond 512 corners it is first thinned to the
extreme ones along fixed directions.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Missed, slice_mesh

MOST_CORNERS = 128
"""Of one convex piece, so that it has no more than 252 faces."""

MOST_HULL = 512
"""Corners of a whole hull."""

FILLED = 0.9
"""Share of its hull that a fragment fills if it collides as its hull."""
PART_FILLED = 0.95
"""Share of its hull below which a part of a hollow fragment is halved once more."""
MOST_HALVINGS = 4
"""Of a hollow fragment, one within the other: it has at most some 16 parts."""


class HullError(ValueError):
    """The simulator cannot hold a fragment of this shape."""


def convex_parts(mesh: Mesh) -> tuple[Mesh, ...]:
    """Meshes whose convex hulls together are like the mesh: itself, unless it fills clearly less than its hull."""
    return (mesh,) if _share(mesh) >= FILLED else _halved(mesh, MOST_HALVINGS)


def hull_pieces(mesh: Mesh) -> list[Floats]:
    """Corners (n, 3) in F [m] of the convex pieces that together are the mesh's convex hull, n <= `MOST_CORNERS`.

    Raises:
        HullError: the corners of the mesh lie in a plane, to rounding.
    """
    try:
        hull = ConvexHull(mesh.vertices)
        if len(hull.vertices) > MOST_HULL:
            hull = ConvexHull(_extremes(mesh.vertices[np.sort(hull.vertices)]))
    except QhullError:
        raise HullError("a fragment is too thin for the simulator: it is flat to rounding") from None
    if len(hull.vertices) <= MOST_CORNERS:
        return [np.asarray(hull.points[np.sort(hull.vertices)])]
    middle = hull.points[hull.vertices].mean(axis=0)  # all facets of the hull are seen from there
    return [np.vstack([hull.points[corners], middle]) for corners in _groups(hull.points, hull.simplices)]


def _share(mesh: Mesh) -> float:
    """Of its convex hull that the mesh fills; 1 where its corners lie in a plane."""
    try:
        return mesh.volume / float(ConvexHull(mesh.vertices).volume)
    except QhullError:
        return 1.0


def _halved(mesh: Mesh, halvings: int) -> tuple[Mesh, ...]:
    """The mesh divided across its length, through its centroid, and its halves likewise."""
    if halvings == 0 or _share(mesh) >= PART_FILLED:
        return (mesh,)
    sliced = slice_mesh(mesh, Plane.through(mesh.centroid, canonical_frame(mesh).rotation[:, 2]))
    if isinstance(sliced, Missed):
        return (mesh,)
    return tuple(part for product in sliced.products for part in _halved(product, halvings - 1))


def _groups(points: Floats, facets: Ints) -> list[Ints]:
    """The corners of `facets` (m, 3), halved along their longest extent until each group has few enough."""
    corners = np.unique(facets)
    if len(corners) < MOST_CORNERS:
        return [corners]
    centres = points[facets].mean(axis=1)
    order = np.argsort(centres[:, np.argmax(np.ptp(centres, axis=0))], kind="stable")
    return [group for half in np.array_split(order, 2) for group in _groups(points, facets[half])]


def _extremes(corners: Floats) -> Floats:
    """The extreme corners along fixed directions, in a box scaled so that a long fragment keeps its ends."""
    count = MOST_HULL - 6
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)  # a Fibonacci spiral
    spiral = np.stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z], axis=1)
    low, high = corners.min(axis=0), corners.max(axis=0)
    even = (corners - (low + high) / 2.0) / (high - low)
    return np.asarray(corners[np.unique(np.argmax(even @ np.vstack([np.eye(3), -np.eye(3), spiral]).T, axis=0))])
