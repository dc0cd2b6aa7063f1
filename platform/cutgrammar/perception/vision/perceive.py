"""From a fused cloud to fragments (IV-D): segmentation and completion, optionally with tracking of known fragments."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh, solid_of
from cutgrammar.perception.vision.belief import Believed, KnownCut, confirm, predict
from cutgrammar.perception.vision.completion import MIRRORED, complete
from cutgrammar.perception.vision.segmentation import UNKNOWN, Segmentation

MIN_VOLUME = 5e-8
"""Minimum volume of a fragment [m3]: 0.05 cm3, a cube of 3.7 mm."""
MIN_SIDE = 0.1
"""A new cluster is divided by the plane of the last cut if at least this share of its points is on each side."""
MAX_SHARED = 0.5
"""Two new clusters are merged if their completions share more than this part of the smaller volume."""
UNSEEN = -1
"""Label of points that belong to no perceived fragment."""


@dataclass(frozen=True, eq=False)
class Perceived:
    """The fragments perceived in a cloud.

    Attributes:
        labels: (n,) index of the fragment that each point belongs to, or `UNSEEN`.
        fragments: the perceived fragments.
        missing: number of further fragments that must exist; they are hidden or not separated from others.
    """

    labels: Ints
    fragments: tuple[Believed, ...]
    missing: int = 0

    @property
    def configuration(self) -> Configuration:
        """The fragments, with frames at their centroids along the axes of W."""
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
    mirrored: float = MIRRORED,
) -> Perceived:
    """Perceive the fragments in a fused cloud; the result is deterministic.

    Args:
        points, normals: (n, 3) points and normals in W, where z = 0 is the top of the board [m].
        segmentation: the segmentation network.
        before: the previous result; None: use the cloud alone.
        cut: the cut made since then.
        mirrored: assumed position of undersides, see `completion.MIRRORED`.
    """
    if len(points) < 2:
        return Perceived(np.full(len(points), UNSEEN), ())
    predicted = [] if before is None else predict(before.fragments, cut)
    confirmed, believed = confirm(predicted, points, normals)
    known = [confirmed[i] for i in np.unique(believed[believed != UNKNOWN])]
    lost = None if before is None else len(predicted) - len(known) + before.missing
    labels = segmentation(points, normals, believed, lost)
    fragments = [Believed(fragment.mesh, points[labels == i]) for i, fragment in enumerate(known)]
    result = np.where(labels < len(known), labels, UNSEEN)
    new = [np.flatnonzero(labels == label) for label in range(len(known), int(labels.max()) + 1)]
    for cluster in _merge_overlapping(new, points, normals, mirrored):
        for fragment, members in _completed(points, normals, cluster, None if cut is None else cut.plane_W, mirrored):
            result[members] = len(fragments)
            fragments.append(fragment)
    missing = 0 if lost is None else max(0, len(known) + lost - len(fragments))
    return Perceived(result, tuple(fragments), missing)


def _merge_overlapping(clusters: list[Ints], points: Floats, normals: Floats, mirrored: float) -> list[Ints]:
    """Merge clusters whose completions overlap, because two fragments cannot occupy the same space."""
    completed = (complete(points[c], normals[c], mirrored) for c in clusters)
    solids = [None if mesh is None else solid_of(mesh) for mesh in completed]
    group = list(range(len(clusters)))
    for i, j in combinations(range(len(clusters)), 2):
        a, b = solids[i], solids[j]
        if a is None or b is None or group[i] == group[j]:
            continue
        if (a ^ b).volume() > MAX_SHARED * min(a.volume(), b.volume()):
            group = [group[i] if g == group[j] else g for g in group]
    return [
        np.sort(np.concatenate([c for c, g in zip(clusters, group, strict=True) if g == name]))
        for name in dict.fromkeys(group)
    ]


def _completed(
    points: Floats, normals: Floats, cluster: Ints, plane_W: Plane | None, mirrored: float
) -> list[tuple[Believed, Ints]]:
    """Complete a cluster: one fragment, two if the last cut divides it, or none if there are too few points."""
    mesh = complete(points[cluster], normals[cluster], mirrored)
    if mesh is None or mesh.volume < MIN_VOLUME:
        return []
    if plane_W is not None:
        above = plane_W.distances(points[cluster]) > 0.0
        if min(above.mean(), 1.0 - above.mean()) >= MIN_SIDE:
            sliced = slice_mesh(mesh, plane_W, MIN_SIDE / 2.0)
            if isinstance(sliced, Sliced):
                # The completion is a convex hull, so there is one product on each side.
                halves = ((sliced.above[0], cluster[above]), (sliced.below[0], cluster[~above]))
                return [(Believed(half, points[members]), members) for half, members in halves]
    return [(Believed(mesh, points[cluster]), cluster)]
