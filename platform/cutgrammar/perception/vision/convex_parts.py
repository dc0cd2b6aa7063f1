"""A closed mesh around the points of a fragment's surface, which need not be convex (IV-D).

Most fragments are convex to within the cameras' noise, and the convex hull of their points is the mesh. A bent one,
such as a banana, leaves a hollow: many of its points lie deep inside its hull. Its points are then halved across their
length repeatedly until the halves are convex, and the mesh is the union of the halves' hulls, which overlap where they
meet. The collision shapes of the simulator are made in the same way (`cutgrammar_sim.physics.hulls`), but from true
meshes.
"""

import numpy as np
from manifold3d import Manifold, OpType
from scipy.spatial import ConvexHull, QhullError

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import mesh_of, solid_of

DEEP = 4e-3
"""Depth below the hull from which on a point counts as lying in a hollow [m]."""
MAX_HOLLOW = 0.05
"""Largest share of such points with which the points count as convex."""
MAX_HALVINGS = 4
"""Nested halvings, which then give at most 16 parts."""
MIN_HALF = 30
"""Minimum number of points of a half."""
MAX_TRIED = 500
"""Maximum number of points whose depth is computed."""
OVERLAP = 2e-3
"""Both halves keep the points this near to the plane between them, so that their hulls overlap [m]."""


def closed_around(points: Floats, added: Floats | None = None) -> Mesh | None:
    """The closed mesh around points (n, 3) and `added` ones (m, 3); None if they are coplanar.

    Args:
        points: observed points of the surface [m]; only they tell whether there is a hollow.
        added: further points of the surface, such as those of an assumed underside.
    """
    added = np.empty((0, 3)) if added is None else added
    parts = _halved(points, added, MAX_HALVINGS)
    hulls = [mesh for part in parts if (mesh := hull(part)) is not None]
    if len(hulls) > 1:
        union = Manifold.batch_boolean([solid_of(mesh) for mesh in hulls], OpType.Add)
        if len(union.decompose()) == 1:
            return mesh_of(union)
    return hull(np.concatenate([points, added]))


def hull(points: Floats) -> Mesh | None:
    """The convex hull of points (n, 3) as a closed mesh; None if they are coplanar."""
    try:
        convex = ConvexHull(points)
    except QhullError:
        return None
    corners = points[convex.simplices]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = convex.simplices.astype(np.int64)
    turned = np.einsum("ij,ij->i", outward, convex.equations[:, :3]) < 0.0
    faces[turned] = faces[turned][:, ::-1]
    used = np.unique(faces)
    number = np.zeros(len(points), dtype=np.int64)
    number[used] = np.arange(len(used))
    mesh = Mesh(points[used], number[faces])
    return mesh if mesh.volume > 0.0 else None


def _halved(points: Floats, added: Floats, halvings: int) -> list[Floats]:
    """The points and added ones; or, if there is a hollow, those of their halves."""
    every = np.concatenate([points, added])
    if halvings == 0 or _share_in_hollows(points) <= MAX_HOLLOW:
        return [every]
    offsets = points - points.mean(axis=0)
    along = np.linalg.eigh(np.einsum("ni,nj->ij", offsets, offsets))[1][:, 2]
    place, added_place = (np.einsum("nj,j->n", each, along) for each in (points, added))
    middle = float(np.median(place))
    if min(np.sum(place > middle), np.sum(place <= middle)) < MIN_HALF:
        return [every]
    return [
        part
        for side in (1.0, -1.0)
        for part in _halved(
            points[side * (place - middle) > -OVERLAP],
            added[side * (added_place - middle) > -OVERLAP],
            halvings - 1,
        )
    ]


def _share_in_hollows(points: Floats) -> float:
    """Share of points (n, 3) that lie deeper than `DEEP` in their hull; 0 if they are coplanar."""
    try:
        equations = ConvexHull(points).equations
    except QhullError:
        return 0.0
    tried = points[:: -(-len(points) // MAX_TRIED)]
    outside = np.einsum("nj,kj->nk", tried, equations[:, :3]) + equations[:, 3]
    return float(np.mean(outside.max(axis=1) < -DEEP))
