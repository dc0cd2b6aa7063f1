"""The collision shape of a fragment: its convex hull, or the hulls of its parts, in pieces that PhysX can hold.

A fragment that nearly fills its hull, as most do, collides as its hull. One that fills less than nine tenths of it, as
a banana, is halved across its length repeatedly, until its parts nearly fill their hulls.

PhysX holds at most 255 faces a hull and drops the others without a warning. So a hull of more than 128 corners is
divided into several pieces, each the hull of some of its facets and its middle; a hull of more than 512 corners is
first thinned to the extreme ones along fixed directions.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Missed, slice_mesh

MAX_PIECE_CORNERS = 128
"""Corners of one convex piece, which then has at most 252 faces."""

MAX_HULL_CORNERS = 512
"""Corners of a whole hull."""

FILLED = 0.9
"""Smallest share of its hull that a fragment fills if it collides as its hull."""
PART_FILLED = 0.95
"""Smallest share of its hull that a part of a hollow fragment fills if it is not halved again."""
MAX_HALVINGS = 4
"""Nested halvings of a hollow fragment, which then has at most about 16 parts."""


class HullError(ValueError):
    """The simulator cannot hold a fragment of this shape."""


def convex_parts(mesh: Mesh) -> tuple[Mesh, ...]:
    """Meshes whose convex hulls together approximate the mesh: itself, unless it fills clearly less than its hull."""
    return (mesh,) if _share(mesh) >= FILLED else _halved(mesh, MAX_HALVINGS)


def hull_pieces(mesh: Mesh) -> list[Floats]:
    """Corners (n, 3) in F [m] of the convex pieces that together are the mesh's convex hull, n <= `MAX_PIECE_CORNERS`.

    Raises:
        HullError: the corners of the mesh lie in a plane, to rounding.
    """
    try:
        hull = ConvexHull(mesh.vertices)
        if len(hull.vertices) > MAX_HULL_CORNERS:
            hull = ConvexHull(_extremes(mesh.vertices[np.sort(hull.vertices)]))
    except QhullError:
        raise HullError("a fragment is too thin for the simulator: it is flat to rounding") from None
    if len(hull.vertices) <= MAX_PIECE_CORNERS:
        return [np.asarray(hull.points[np.sort(hull.vertices)])]
    middle = hull.points[hull.vertices].mean(axis=0)  # all facets of the hull are visible from it
    return [np.vstack([hull.points[corners], middle]) for corners in _groups(hull.points, hull.simplices)]


def _share(mesh: Mesh) -> float:
    """Share of its convex hull that the mesh fills; 1 if its corners lie in a plane."""
    try:
        return mesh.volume / float(ConvexHull(mesh.vertices).volume)
    except QhullError:
        return 1.0


def _halved(mesh: Mesh, halvings: int) -> tuple[Mesh, ...]:
    """The mesh divided across its length through its centroid, and its halves divided in the same way."""
    if halvings == 0 or _share(mesh) >= PART_FILLED:
        return (mesh,)
    sliced = slice_mesh(mesh, Plane.through(mesh.centroid, canonical_frame(mesh).rotation[:, 2]))
    if isinstance(sliced, Missed):
        return (mesh,)
    return tuple(part for product in sliced.products for part in _halved(product, halvings - 1))


def _groups(points: Floats, facets: Ints) -> list[Ints]:
    """The corners of `facets` (m, 3), halved along their longest extent until each group is small enough."""
    corners = np.unique(facets)
    if len(corners) < MAX_PIECE_CORNERS:
        return [corners]
    centres = points[facets].mean(axis=1)
    order = np.argsort(centres[:, np.argmax(np.ptp(centres, axis=0))], kind="stable")
    return [group for half in np.array_split(order, 2) for group in _groups(points, facets[half])]


def _extremes(corners: Floats) -> Floats:
    """The extreme corners along fixed directions, after scaling to a cube so that a long fragment keeps its ends."""
    count = MAX_HULL_CORNERS - 6
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)  # a Fibonacci spiral
    spiral = np.stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z], axis=1)
    low, high = corners.min(axis=0), corners.max(axis=0)
    even = (corners - (low + high) / 2.0) / (high - low)
    return np.asarray(corners[np.unique(np.argmax(even @ np.vstack([np.eye(3), -np.eye(3), spiral]).T, axis=0))])
