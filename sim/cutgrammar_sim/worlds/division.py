"""Which fragments a cut means, and their products: the part of cutting that all worlds share.

A cut names its fragments by centroid, so that perceived and true fragments need no common ids. A centroid means the
nearest fragment among those that the plane crosses. The cut is refused if that fragment does not reach as far as the
centroid, or if a fragment that the plane misses is less than half as far away: then that one was meant.
"""

from collections.abc import Mapping

import numpy as np

from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Missed, Sliced, slice_mesh
from cutgrammar.interfaces import Cut, Refused


def divide(now: Configuration, cut: Cut, min_share: float) -> Mapping[int, Sliced] | Refused:
    """The products of the fragments that `cut` means, by index in `now`, ascending; either all are cut or none.

    Args:
        now: the true fragments, meshes, in the world frame.
        cut: plane and centroids in the world frame.
        min_share: smallest share of its fragment's volume that a product may have.

    Returns:
        The products in the frames F of their fragments, or why the cut is refused.
    """
    meant = fragments_meant(now, cut)
    if isinstance(meant, Refused):
        return meant
    divided: dict[int, Sliced] = {}
    for index in meant:
        plane_F = cut.plane_W.transformed(now[index].X_WF.inverse())
        sliced = slice_mesh(now[index].mesh, plane_F, min_share)
        if isinstance(sliced, Missed):
            return Refused(sliced.reason)
        divided[index] = sliced
    return divided


def fragments_meant(now: Configuration, cut: Cut) -> tuple[int, ...] | Refused:
    """Indices in `now` of the fragments that `cut` means, ascending, or why there are none."""
    if not len(cut.p_WC):
        return Refused("the cut names no fragment")
    if not now:
        return Refused("no fragment lies there")
    crossed = np.array([crosses(cut.plane_W, fragment) for fragment in now])
    reach = np.array([_radius(fragment) for fragment in now])
    centres = np.array([fragment.p_WC for fragment in now])
    meant = set()
    for p_WC in cut.p_WC:
        distances = np.linalg.norm(centres - p_WC, axis=1)
        if not (distances <= reach).any():
            return Refused("no fragment lies there")
        candidates = np.flatnonzero(crossed & (distances <= reach))
        if not len(candidates):
            return Refused("the plane misses the fragment")
        chosen = int(candidates[np.argmin(distances[candidates])])
        if distances.min() < 0.5 * distances[chosen]:
            return Refused("the plane misses the fragment")
        meant.add(chosen)
    return tuple(sorted(meant))


def crosses(plane_W: Plane, fragment: Fragment) -> bool:
    """Whether corners of the fragment's mesh lie on both sides of the plane."""
    distances = plane_W.transformed(fragment.X_WF.inverse()).distances(fragment.mesh.vertices)
    return bool(distances.min() < 0.0 < distances.max())


def _radius(fragment: Fragment) -> float:
    """Largest distance of the fragment's corners from its centroid [m]."""
    return float(np.linalg.norm(fragment.mesh.vertices - fragment.mesh.centroid, axis=1).max())
