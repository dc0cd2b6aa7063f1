"""Conservation of fragments: between two looks none appears but by a cut, and none vanishes.

The robot knows how many fragments there were and which it has divided since, so it knows how many there are now. This
module holds the perceived fragments to that number. New clusters that the plane of the last cut passes are divided; if
there are more than fragments were lost, those are joined that then have the volumes of the lost ones. A lost fragment
to which no cluster belongs is hidden by others or has too few points to be found: it is kept where it was predicted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.perception.vision.belief import Believed, nearest_mesh

MIN_SIDE = 0.1
"""A new cluster is divided by the plane of the last cut if at least this share of its points is on each side."""
VOLUME_SCALE = 0.03
"""Distance that counts as much as a ratio e of volumes, when new clusters are assigned to lost fragments [m]."""


@dataclass(frozen=True, eq=False)
class Found:
    """A fragment found in the cloud.

    Attributes:
        fragment: its completed mesh and its points.
        members: (n,) indices of its points in the cloud.
    """

    fragment: Believed
    members: Ints


Complete = Callable[[Ints], Found | None]
"""Makes a fragment of the points of the cloud with these indices; None if there are too few."""


def divided_by(found: Found, plane_W: Plane, min_side: float = MIN_SIDE) -> list[Found]:
    """The parts of a new fragment that a plane divides; the fragment itself if it does not.

    Args:
        found: the new fragment.
        plane_W: the plane of the last cut, or of a seam.
        min_side: minimum share of the points on each side of it.
    """
    points = found.fragment.observed
    above = plane_W.distances(points) > 0.0
    if min(above.mean(), 1.0 - above.mean()) < min_side:
        return [found]
    sliced = slice_mesh(found.fragment.mesh, plane_W, min_side / 2.0)
    if not isinstance(sliced, Sliced):
        return [found]
    parts = []
    for meshes, side in ((sliced.above, np.flatnonzero(above)), (sliced.below, np.flatnonzero(~above))):
        nearest = nearest_mesh(meshes, points[side])
        for i, mesh in enumerate(meshes):
            own = side[nearest == i]
            parts.append(Found(Believed(mesh, points[own]), found.members[own]))
    return parts


def held_to(
    found: Sequence[Found], lost: Sequence[Believed], expected: int, plane_W: Plane | None, complete: Complete
) -> list[Found]:
    """At most `expected` new fragments.

    The plane of the last cut divides those that it passes. While there are too many, two are joined or the smallest is
    left out, whichever gives the volumes that are most like those of the lost fragments.

    Args:
        found: the new fragments in the cloud.
        lost: the lost fragments.
        expected: number of fragments that are looked for, at least the number of lost ones.
        plane_W: plane of the last cut, if there was one.
        complete: makes a fragment of points of the cloud.
    """
    now: list[Found] = []
    for each in found if expected else ():
        now += [each] if plane_W is None else divided_by(each, plane_W)
    volumes = np.array([one.mesh.volume for one in lost])
    while len(now) > expected:
        smallest = min(range(len(now)), key=lambda i: len(now[i].members))
        options = [[*now[:smallest], *now[smallest + 1 :]]]
        for i, j in combinations(range(len(now)), 2):
            joined = complete(np.sort(np.concatenate([now[i].members, now[j].members])))
            if joined is not None:
                options.append([joined if k == i else now[k] for k in range(len(now)) if k != j])
        now = min(options, key=lambda option: _unlikeness(volumes, option))
    return now


def _unlikeness(volumes: Floats, found: Sequence[Found]) -> float:
    """Sum of the differences of volumes [m3] between lost fragments and those found, assigned; others count whole."""
    mine = np.array([one.fragment.mesh.volume for one in found])
    apart = np.abs(volumes[:, None] - mine)
    rows, columns = linear_sum_assignment(apart)
    rest = volumes.sum() - volumes[rows].sum() + mine.sum() - mine[columns].sum()
    return float(apart[rows, columns].sum() + rest)


def hidden(lost: Sequence[Believed], found: Sequence[Found]) -> list[Believed]:
    """The lost fragments to which none of the new ones belongs, where they were predicted.

    New fragments are assigned to lost ones by distance between centroids and ratio of volumes.
    """
    if not found or not lost:
        return list(lost)
    centres = np.array([one.fragment.mesh.centroid for one in found])
    volumes = np.array([one.fragment.mesh.volume for one in found])
    lost_centres = np.array([one.mesh.centroid for one in lost])
    lost_volumes = np.array([one.mesh.volume for one in lost])
    cost = np.linalg.norm(lost_centres[:, None] - centres, axis=2)
    cost += VOLUME_SCALE * np.abs(np.log(lost_volumes)[:, None] - np.log(volumes))
    taken = set(linear_sum_assignment(cost)[0].tolist())
    return [one for i, one in enumerate(lost) if i not in taken]
