"""From a fused cloud to fragments (IV-D): segmentation and completion, optionally with tracking of known fragments."""

from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import solid_of
from cutgrammar.perception.vision.belief import Believed, KnownCut, confirm, predict
from cutgrammar.perception.vision.completion import MIRRORED, complete
from cutgrammar.perception.vision.conservation import Found, divided_by, held_to, hidden
from cutgrammar.perception.vision.seams import MIN_SIDE, find_seam
from cutgrammar.perception.vision.segmentation import UNKNOWN, Segmentation

MIN_VOLUME = 5e-8
"""Minimum volume of a fragment [m3]: 0.05 cm3, a cube of 3.7 mm."""
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
    seams: bool = False,
) -> Perceived:
    """Perceive the fragments in a fused cloud; the result is deterministic.

    Args:
        points, normals: (n, 3) points and normals in W, where z = 0 is the top of the board [m].
        segmentation: the segmentation network.
        before: the previous result; None: use the cloud alone.
        cut: the cut made since then.
        mirrored: assumed position of undersides, see `completion.MIRRORED`.
        seams: whether seams are searched, see `seams`; without effect if there is a previous result, because then the
            number of fragments is known.
    """
    if len(points) < 2:
        return Perceived(np.full(len(points), UNSEEN), ())
    predicted = [] if before is None else predict(before.fragments, cut)
    fitted, believed = confirm(predicted, points, normals)
    known = np.unique(believed[believed != UNKNOWN])
    lost = [fragment for i, fragment in enumerate(predicted) if i not in known]
    expected = None if before is None else len(lost) + before.missing
    labels = segmentation(points, normals, believed, expected)
    fragments = [Believed(fitted[i].mesh, points[labels == number]) for number, i in enumerate(known)]
    result = np.where(labels < len(known), labels, UNSEEN)
    clusters = [np.flatnonzero(labels == label) for label in range(len(known), int(labels.max()) + 1)]
    clusters = _merge_overlapping(clusters, points, normals, mirrored)
    completed = partial(_completed, points, normals, mirrored)
    found = [one for cluster in clusters if (one := completed(cluster)) is not None]
    if expected is None:
        found = [part for one in found for part in (_at_seams(one, normals) if seams else [one])]
    else:
        found = held_to(found, lost, expected, None if cut is None else cut.plane_W, completed)
    for new in found:
        result[new.members] = len(fragments)
        fragments.append(new.fragment)
    fragments += hidden(lost, found)
    total = len(fragments) if expected is None else len(known) + expected
    return Perceived(result, tuple(fragments), max(0, total - len(fragments)))


def _at_seams(found: Found, normals: Floats) -> list[Found]:
    """The parts of a new fragment between its visible seams; normals (n, 3) are those of the cloud."""
    seam = find_seam(found.fragment.observed, normals[found.members])
    parts = [found] if seam is None else divided_by(found, seam.plane_W, MIN_SIDE)
    return parts if len(parts) == 1 else [part for one in parts for part in _at_seams(one, normals)]


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


def _completed(points: Floats, normals: Floats, mirrored: float, cluster: Ints) -> Found | None:
    """A cluster completed to a fragment; None if there are too few points."""
    mesh = complete(points[cluster], normals[cluster], mirrored)
    if mesh is None or mesh.volume < MIN_VOLUME:
        return None
    return Found(Believed(mesh, points[cluster]), cluster)
