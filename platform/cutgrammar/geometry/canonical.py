"""The canonical frame C of a fragment (III-D), by principal component analysis.

The origin is the centroid, z the axis of the largest variance and x that of the smallest. Of the four sign choices that
give a proper rotation, the frame uses the one with the largest volume in the first octant. For meshes, moments and
octant volumes are exact. Reading taken: volumes that differ by less than 1e-9 of the total count as equal, and the
first of `FLIPS` is used. For nearly symmetric fragments the signs are noise, so comparisons of shapes try all `FLIPS`.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.fragment import Cloud, Mesh, vertices_of
from cutgrammar.geometry.pose import Pose

FLIPS: tuple[Pose, ...] = tuple(
    Pose(np.diag(signs), np.zeros(3)) for signs in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])
)
"""The four sign choices of the axes that give proper rotations, as rotations about the origin of C."""


def canonical_frame(shape: Mesh | Cloud) -> Pose:
    """X_FC: the canonical frame of `shape` in the fragment's frame F (III-D).

    Raises:
        ValueError: a mesh without volume, or a cloud with fewer than four points.
    """
    axes = _principal_axes(shape)
    X_FA = Pose(axes, shape.centroid)
    octants = _octants(shape, X_FA.inverse())
    first = [octants[_octant_of(np.diag(flip.rotation))] for flip in FLIPS]
    best = next(i for i in range(4) if first[i] >= max(first) - 1e-9 * abs(sum(octants)))
    return X_FA @ FLIPS[best]


def extents(shape: Mesh | Cloud, X_FC: Pose) -> tuple[Floats, Floats]:
    """Lower and upper corner (3,), (3,) of the shape's bounding box in the canonical frame C [m]."""
    p_CV = X_FC.inverse().apply(vertices_of(shape))
    return p_CV.min(axis=0), p_CV.max(axis=0)


def covariance(shape: Mesh | Cloud) -> Floats:
    """(3, 3) second central moment in F [m2]: of the enclosed volume (exact) or of the points.

    Raises:
        ValueError: a mesh without volume, or a cloud with fewer than four points.
    """
    if isinstance(shape, Cloud):
        if len(shape.points) < 4:
            raise ValueError(f"{len(shape.points)} points are too few for a canonical frame; at least 4 are needed")
        centred = shape.points - shape.centroid
        return np.asarray(centred.T @ centred / len(centred))
    if shape.volume <= 0.0:
        raise ValueError(f"the mesh encloses {shape.volume:.3g} m3; a positive volume is needed")
    a, b, c = np.moveaxis(shape.triangles - shape.centroid, 1, 0)
    weights = np.einsum("ij,ij->i", a, np.cross(b, c)) / 120.0
    total = a + b + c
    moment = sum(np.einsum("i,ij,ik->jk", weights, v, v) for v in (a, b, c, total))
    return np.asarray(moment / shape.volume)


def _principal_axes(shape: Mesh | Cloud) -> Floats:
    axes: Floats = np.linalg.eigh(
        covariance(shape)
    ).eigenvectors  # ascending: x has the smallest variance, z the largest
    for column in (0, 2):  # eigh does not define the signs: make them deterministic first
        axes[:, column] *= np.sign(axes[np.argmax(np.abs(axes[:, column])), column])
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    return axes


def _octant_of(signs: Floats) -> int:
    return int(4 * (signs[0] < 0) + 2 * (signs[1] < 0) + (signs[2] < 0))


def _octants(shape: Mesh | Cloud, X_AF: Pose) -> Floats:
    """(8,) volume (or number of points) in each octant about the origin of A."""
    if isinstance(shape, Cloud):
        points = X_AF.apply(shape.points)
        return np.asarray(np.bincount(_octant_indices(points), minlength=8), dtype=np.float64)
    triangles = X_AF.apply(shape.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    return cell_volumes(triangles, np.ones(3), 1)[::-1, ::-1, ::-1].ravel()  # the positive octant first


def _octant_indices(points: Floats) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    return np.asarray((points < 0) @ np.array([4, 2, 1]), dtype=np.intp)
