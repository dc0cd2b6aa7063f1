"""From a fused cloud to fragments (IV-D): segmented, each one completed, with or without what is known from before."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh, solid_of
from cutgrammar.perception.vision.belief import Believed, KnownCut, confirmed, foreseen
from cutgrammar.perception.vision.completion import complete
from cutgrammar.perception.vision.segmentation import UNKNOWN, Segmentation

SMALLEST = 5e-8
"""What is completed to less than this is no fragment [m3]: 0.05 cm3, a cube of 3.7 mm."""
LEAST_SIDE = 0.1
"""A new cluster is divided by the plane of the last cut if this share of its points lies on either side."""
SHARED = 0.5
"""Two new clusters are one fragment if their completions share this part of the smaller one's volume."""
UNSEEN = -1
"""Label of a point that belongs to nothing perceived."""


@dataclass(frozen=True, eq=False)
class Perceived:
    """What a robot makes of a cloud.

    Attributes:
        labels: (n,) the fragment that each point belongs to, `UNSEEN` for none.
        fragments: as they are believed to be.
        missing: how many more there must be, since none vanishes; they are out of sight or not told apart.
    """

    labels: Ints
    fragments: tuple[Believed, ...]
    missing: int = 0

    @property
    def configuration(self) -> Configuration:
        """The fragments, each in a frame at its centroid with the axes of W."""
        meshes = [fragment.mesh for fragment in self.fragments]
        return tuple(
            Fragment(mesh.moved(Pose(np.eye(3), -mesh.centroid)), Pose(np.eye(3), mesh.centroid)) for mesh in meshes
        )


def perceive(
    points: Floats,
    normals: Floats,
    segmentation: Segmentation,
    before: Perceived | None = None,
    cut: KnownCut | None = None,
) -> Perceived:
    """The fragments in a fused cloud; the same arguments give the same bits.

    Args:
        points, normals: (n, 3) in W, whose z = 0 is the board's top [m].
        segmentation: the network.
        before: what was perceived last; None: the cloud alone tells.
        cut: made since then.
    """
    if len(points) < 2:
        return Perceived(np.full(len(points), UNSEEN), ())
    expected = [] if before is None else foreseen(before.fragments, cut)
    there, believed = confirmed(expected, points, normals)
    known = [there[i] for i in np.unique(believed[believed != UNKNOWN])]
    lost = None if before is None else len(expected) - len(known) + before.missing
    labels = segmentation(points, normals, believed, lost)
    fragments = [Believed(fragment.mesh, points[labels == i]) for i, fragment in enumerate(known)]
    result = np.where(labels < len(known), labels, UNSEEN)
    new = [np.flatnonzero(labels == label) for label in range(len(known), int(labels.max()) + 1)]
    for own in _joined(new, points, normals):
        for fragment, members in _completed(points, normals, own, None if cut is None else cut.plane_W):
            result[members] = len(fragments)
            fragments.append(fragment)
    missing = 0 if lost is None else max(0, len(known) + lost - len(fragments))
    return Perceived(result, tuple(fragments), missing)


def _joined(clusters: list[Ints], points: Floats, normals: Floats) -> list[Ints]:
    """The clusters, those joined whose completions lie within one another: two fragments cannot be in one place."""
    solids = [None if mesh is None else solid_of(mesh) for mesh in (complete(points[c], normals[c]) for c in clusters)]
    group = list(range(len(clusters)))
    for i, j in combinations(range(len(clusters)), 2):
        a, b = solids[i], solids[j]
        if a is None or b is None or group[i] == group[j]:
            continue
        if (a ^ b).volume() > SHARED * min(a.volume(), b.volume()):
            group = [group[i] if g == group[j] else g for g in group]
    return [
        np.sort(np.concatenate([c for c, g in zip(clusters, group, strict=True) if g == name]))
        for name in dict.fromkeys(group)
    ]


def _completed(points: Floats, normals: Floats, own: Ints, plane_W: Plane | None) -> list[tuple[Believed, Ints]]:
    """A cluster as one fragment, as two where the blade has gone through it, or none if too little is seen of it."""
    mesh = complete(points[own], normals[own])
    if mesh is None or mesh.volume < SMALLEST:
        return []
    if plane_W is not None:
        above = plane_W.distances(points[own]) > 0.0
        if min(above.mean(), 1.0 - above.mean()) >= LEAST_SIDE:
            sliced = slice_mesh(mesh, plane_W, LEAST_SIDE / 2.0)
            if isinstance(sliced, Sliced):
                halves = ((sliced.above[0], own[above]), (sliced.below[0], own[~above]))  # a convex hull has two
                return [(Believed(half, points[members]), members) for half, members in halves]
    return [(Believed(mesh, points[own]), own)]
