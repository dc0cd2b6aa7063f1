"""What a robot still knows, when it looks again, of the fragments that it saw before and of the cut it has just made.

Two halves of a cut lie as far apart as the blade is thick; no depth camera shows such a seam, and none shows the faces
along it. But the robot knows the plane it has cut with, where it has carried a fragment to, and what it saw before. So
every fragment that was seen is kept as a closed mesh with the points seen of it; the one that was cut is carried along
with the blade's frame and divided by the blade's plane; and what is foreseen so is held to where the new cloud agrees
with it. All else, such as a slice that has toppled, is segmented by the network alone and completed anew.

Nothing here is known from the simulator: the plane is where the blade truly went, which joint angles tell.
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
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.perception.vision.segmentation import UNKNOWN

NEAR = 6e-3
"""A point seen before looks for itself in the new cloud no farther than this [m]."""
THICKNESS = 2e-3
"""It has found itself on a surface no farther off than this, along the normal [m]."""
HELD = 0.75
"""A fragment is where it was foreseen if this share of the points seen of it have found themselves."""
FEWEST = 15
"""With fewer points seen of it before, nothing is foreseen."""
SIDEWAYS = 4e-3
"""A new point this near to one that was foreseen belongs to the same fragment [m]."""
ROUNDS = 4
"""Of fitting what was foreseen to the new cloud."""
STIFFNESS = 1e-2
"""By how much a shift is resisted, as a share of the points; it decides where the cloud says nothing."""


@dataclass(frozen=True, eq=False)
class Believed:
    """A fragment as it is believed to be.

    Attributes:
        mesh: in W, completed.
        seen: (n, 3) points that were seen of it, in W [m].
    """

    mesh: Mesh
    seen: Floats

    def moved(self, X: Pose) -> "Believed":
        """The same, moved by X in W."""
        return Believed(self.mesh.moved(X), X.apply(self.seen))


@dataclass(frozen=True, eq=False)
class KnownCut:
    """What a robot knows of a cut it has made.

    Attributes:
        plane_W: along which the blade went.
        fragments: indices of the believed fragments that were cut.
        X_carried: by how much they were moved before, in W.
    """

    plane_W: Plane
    fragments: tuple[int, ...]
    X_carried: Pose


def foreseen(before: Sequence[Believed], cut: KnownCut | None) -> list[Believed]:
    """The fragments after a cut, if nothing has moved since; halves that were hardly seen are left out."""
    if cut is None:
        return list(before)
    after: list[Believed] = []
    for index, fragment in enumerate(before):
        if index not in cut.fragments:
            after.append(fragment)
            continue
        there = fragment.moved(cut.X_carried)
        sliced = slice_mesh(there.mesh, cut.plane_W, 1e-3)
        if not isinstance(sliced, Sliced):  # what was believed of it was wrong
            continue
        side = cut.plane_W.distances(there.seen) > 0.0
        for meshes, seen in ((sliced.above, there.seen[side]), (sliced.below, there.seen[~side])):
            after += [Believed(mesh, seen) for mesh in meshes]
    return after


def confirmed(expected: Sequence[Believed], points: Floats, normals: Floats) -> tuple[list[Believed], Ints]:
    """Which of the fragments foreseen are there, moved a little to fit the new cloud, and which points are theirs.

    Args:
        expected: what is foreseen.
        points, normals: (n, 3) of the new cloud.

    Returns:
        The fragments that are there, and for each point (n,) the index of the one it belongs to, or `UNKNOWN`.
    """
    believed = np.full(len(points), UNKNOWN)
    tree = cKDTree(points)
    there = [fitted for fragment in expected if (fitted := _fitted(fragment, tree, points, normals)) is not None]
    if there:
        own = np.concatenate([np.full(len(fragment.seen), i) for i, fragment in enumerate(there)])
        distance, nearest = cKDTree(np.concatenate([fragment.seen for fragment in there])).query(points)
        near = distance <= SIDEWAYS
        believed[near] = own[nearest[near]]
    return there, believed


def _fitted(fragment: Believed, tree: cKDTree, points: Floats, normals: Floats) -> Believed | None:
    """The fragment moved by a few millimetres onto the cloud; None where it is not there."""
    if len(fragment.seen) < FEWEST:
        return None
    moved = fragment
    for _ in range(ROUNDS):
        distance, nearest = tree.query(moved.seen)
        near = distance <= NEAR
        if near.mean() < HELD:
            return None
        moved = moved.moved(_step(moved.seen[near], points[nearest[near]], normals[nearest[near]]))
    distance, nearest = tree.query(moved.seen)
    off = np.abs(np.einsum("ij,ij->i", moved.seen - points[nearest], normals[nearest]))
    found = (distance <= NEAR) & (off <= THICKNESS)
    return moved if found.mean() >= HELD else None


def _step(seen: Floats, onto: Floats, normals: Floats) -> Pose:
    """The small motion that brings points (n, 3) closest to planes through `onto` (n, 3), about their middle."""
    middle = seen.mean(axis=0)
    size = max(float(np.linalg.norm(seen - middle, axis=1).max()), 1e-6)
    rows = np.hstack([np.cross((seen - middle) / size, normals), normals])
    off = np.einsum("ij,ij->i", onto - seen, normals)
    normal_matrix = np.einsum("ni,nj->ij", rows, rows)  # sums in one order, whatever the number of threads
    solved = np.linalg.solve(normal_matrix + STIFFNESS * len(seen) * np.eye(6), np.einsum("ni,n->i", rows, off))
    rotation = Rotation.from_rotvec(solved[:3] / size).as_matrix()
    return Pose(rotation, middle + solved[3:] - rotation @ middle)
