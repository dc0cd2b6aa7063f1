"""Tracking of fragments over several views, using the cuts that the robot has made in between.

The two halves of a cut are only a blade's thickness apart. Depth cameras show neither this seam nor the faces along it,
but the robot knows the plane of its cut, how it moved the fragment before, and what it saw earlier. Every perceived
fragment is therefore stored as a closed mesh with its observed points. After a cut, the stored fragment is moved as the
robot moved it and divided by the plane of the blade. Predicted fragments that agree with the new cloud are kept; all
other points, e.g. those of a slice that has fallen over, are segmented by the network alone and completed anew.

Nothing is taken from the simulator: the plane is that of the executed cut, which follows from the joint angles.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.perception.vision.segmentation import UNKNOWN

MAX_DISTANCE = 6e-3
"""Maximum distance between an observed point and its match in the new cloud [m]."""
MAX_OFFSET = 2e-3
"""Maximum distance between them along the normal [m]."""
MIN_MATCHED = 0.75
"""Minimum share of a predicted fragment's observed points with a match, for the fragment to be confirmed."""
MIN_POINTS = 15
"""Minimum number of observed points of a fragment that can be confirmed."""
ASSIGN_DISTANCE = 4e-3
"""New points within this distance of a confirmed fragment's observed points belong to it [m]."""
MIN_EXTENT = 0.05
"""A cut that was made divides the fragment, also where its estimate lies elsewhere: the plane is shifted into the
estimate until at least this share of its extent along the normal lies on each side."""
N_SAMPLES = 512
"""Number of surface points of each product of a cut, to which the observed points are assigned."""
FIT_ROUNDS = 4
"""Number of iterations when a predicted fragment is fitted to the new cloud."""
STIFFNESS = 1e-2
"""Regularisation of the fit, per point; it determines the motion in directions that the cloud does not constrain."""


@dataclass(frozen=True, eq=False)
class Believed:
    """The robot's estimate of a fragment.

    Attributes:
        mesh: its completed mesh in W.
        observed: (n, 3) its observed points in W [m].
    """

    mesh: Mesh
    observed: Floats

    def moved(self, X: Pose) -> "Believed":
        """The fragment moved by X in W."""
        return Believed(self.mesh.moved(X), X.apply(self.observed))


@dataclass(frozen=True, eq=False)
class KnownCut:
    """A cut that the robot has made.

    Attributes:
        plane_W: the plane of the blade.
        fragments: indices of the believed fragments that were cut.
        moves: (index of a believed fragment, motion in W) by which the robot moved fragments before the cut.
    """

    plane_W: Plane
    fragments: tuple[int, ...]
    moves: tuple[tuple[int, Pose], ...] = ()


def predict(before: Sequence[Believed], cut: KnownCut | None) -> list[Believed]:
    """The fragments after `cut`, if nothing has moved since."""
    if cut is None:
        return list(before)
    now = list(before)
    after: list[Believed] = []
    for index, X_move in cut.moves:
        now[index] = now[index].moved(X_move)
    for index, moved in enumerate(now):
        if index not in cut.fragments:
            after.append(moved)
            continue
        plane_W = _within(moved.mesh, cut.plane_W)
        sliced = slice_mesh(moved.mesh, plane_W, 1e-3)
        if not isinstance(sliced, Sliced):
            after.append(moved)
            continue
        above = plane_W.distances(moved.observed) > 0.0
        for meshes, observed in ((sliced.above, moved.observed[above]), (sliced.below, moved.observed[~above])):
            nearest = nearest_mesh(meshes, observed)
            after += [Believed(mesh, observed[nearest == i]) for i, mesh in enumerate(meshes)]
    return after


def nearest_mesh(meshes: Sequence[Mesh], points: Floats) -> Ints:
    """(n,) the mesh to whose surface each of the points (n, 3) is nearest; a cut of a bent fragment leaves several."""
    if len(meshes) == 1:
        return np.zeros(len(points), dtype=np.int64)
    samples = [sample_surface(mesh, N_SAMPLES).points for mesh in meshes]
    return np.asarray(np.argmin([cKDTree(each).query(points)[0] for each in samples], axis=0), dtype=np.int64)


def _within(mesh: Mesh, plane_W: Plane) -> Plane:
    """The plane, shifted along its normal if less than `MIN_EXTENT` of the mesh's extent lies on one of its sides."""
    distances = plane_W.distances(mesh.vertices)
    low, high = float(distances.min()), float(distances.max())
    margin = MIN_EXTENT * (high - low)
    shift = min(max(0.0, low + margin), high - margin)
    return plane_W if shift == 0.0 else Plane(plane_W.normal, plane_W.offset - shift)


def confirm(predicted: Sequence[Believed], points: Floats, normals: Floats) -> tuple[dict[int, Believed], Ints]:
    """Find predicted fragments in the new cloud, fit them to it, and assign points to them.

    Args:
        predicted: the predicted fragments.
        points, normals: (n, 3) points and normals of the new cloud.

    Returns:
        The confirmed fragments by index in `predicted`, and for each point (n,) that index, or `UNKNOWN`.
    """
    believed = np.full(len(points), UNKNOWN)
    tree = cKDTree(points)
    fitted = [_fitted(fragment, tree, points, normals) for fragment in predicted]
    confirmed = {i: fragment for i, fragment in enumerate(fitted) if fragment is not None}
    if confirmed:
        owners = np.concatenate([np.full(len(fragment.observed), i) for i, fragment in confirmed.items()])
        distance, nearest = cKDTree(np.concatenate([each.observed for each in confirmed.values()])).query(points)
        near = distance <= ASSIGN_DISTANCE
        believed[near] = owners[nearest[near]]
    return confirmed, believed


def _fitted(fragment: Believed, tree: cKDTree, points: Floats, normals: Floats) -> Believed | None:
    """The fragment fitted to the cloud by a motion of a few millimetres; None if it is not found."""
    if len(fragment.observed) < MIN_POINTS:
        return None
    moved = fragment
    for _ in range(FIT_ROUNDS):
        distance, nearest = tree.query(moved.observed)
        near = distance <= MAX_DISTANCE
        if near.mean() < MIN_MATCHED:
            return None
        moved = moved.moved(_step(moved.observed[near], points[nearest[near]], normals[nearest[near]]))
    distance, nearest = tree.query(moved.observed)
    offsets = np.abs(np.einsum("ij,ij->i", moved.observed - points[nearest], normals[nearest]))
    matched = (distance <= MAX_DISTANCE) & (offsets <= MAX_OFFSET)
    return moved if matched.mean() >= MIN_MATCHED else None


def _step(observed: Floats, onto: Floats, normals: Floats) -> Pose:
    """The small motion about their mean that moves points (n, 3) closest to the tangent planes at `onto` (n, 3)."""
    middle = observed.mean(axis=0)
    size = max(float(np.linalg.norm(observed - middle, axis=1).max()), 1e-6)
    rows = np.hstack([np.cross((observed - middle) / size, normals), normals])
    offsets = np.einsum("ij,ij->i", onto - observed, normals)
    normal_matrix = np.einsum("ni,nj->ij", rows, rows)  # fixed order of summation for any number of threads
    solved = np.linalg.solve(normal_matrix + STIFFNESS * len(observed) * np.eye(6), np.einsum("ni,n->i", rows, offsets))
    rotation = Rotation.from_rotvec(solved[:3] / size).as_matrix()
    return Pose(rotation, middle + solved[3:] - rotation @ middle)
