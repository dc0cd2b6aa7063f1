"""Colours of fragments: the skin of their food, and its flesh where a cut has exposed it."""

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.facets import facets_of
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh

SKIN_AND_FLESH = MappingProxyType(
    {
        "carrot": ((0.91, 0.45, 0.13), (0.97, 0.62, 0.25)),
        "cucumber": ((0.18, 0.40, 0.16), (0.80, 0.90, 0.62)),
        "potato": ((0.66, 0.50, 0.32), (0.95, 0.88, 0.62)),
        "courgette": ((0.26, 0.48, 0.20), (0.91, 0.93, 0.70)),
        "block": ((0.95, 0.91, 0.80), (0.98, 0.96, 0.89)),
        "apple": ((0.78, 0.14, 0.13), (0.98, 0.94, 0.78)),
        "aubergine": ((0.30, 0.13, 0.32), (0.93, 0.90, 0.74)),
        "banana": ((0.96, 0.82, 0.25), (0.98, 0.94, 0.77)),
    }
)
"""Colours of every food: red, green and blue from 0 to 1."""
NEUTRAL = ((0.80, 0.60, 0.40), (0.96, 0.88, 0.72))
"""Colours of any other food."""


def foods_after(before: Configuration, foods: Sequence[str], after: Configuration) -> tuple[str, ...]:
    """The food of each fragment of `after`, given the foods of those `before`.

    A fragment that was not cut keeps its mesh. A product has the food of the nearest fragment that is gone.
    """
    if len(set(foods)) == 1:
        return (foods[0],) * len(after)
    kept = [_index_of(fragment, before) for fragment in after]
    gone = [i for i in range(len(before)) if i not in kept] or list(range(len(before)))
    result = []
    for fragment, index in zip(after, kept, strict=True):
        if index is None:
            index = min(gone, key=lambda i: float(np.linalg.norm(before[i].p_WC - fragment.p_WC)))
        result.append(foods[index])
    return tuple(result)


def _index_of(fragment: Fragment, configuration: Configuration) -> int | None:
    """The index of the fragment with the same mesh."""
    for i, other in enumerate(configuration):
        if other.shape is fragment.shape or np.array_equal(other.mesh.vertices, fragment.mesh.vertices):
            return i
    return None


def largest_facet(start: Configuration) -> float:
    """Area of the largest flat part of any initial object [m2]: larger flat parts that appear later come from cuts.

    A single triangle counts as a flat part, too, because two neighbours may lie in one plane by chance.
    """
    areas = [facet.area for fragment in start for facet in facets_of(fragment.mesh)[:1]]
    triangles = [fragment.mesh.triangles for fragment in start]
    areas += [float(np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).max()) for t in triangles]
    return max(areas, default=0.0)


def face_colours(mesh: Mesh, food: str, max_skin_facet: float) -> Floats:
    """(m, 3) colours of the faces of a fragment; flat parts of more than `max_skin_facet` [m2] show the flesh."""
    skin, flesh = SKIN_AND_FLESH.get(food, NEUTRAL)
    colours = np.broadcast_to(skin, (len(mesh.faces), 3)).copy()
    for facet in facets_of(mesh):
        if facet.area > 1.05 * max_skin_facet:
            heights = mesh.triangles @ facet.plane_F.normal + facet.plane_F.offset
            colours[np.abs(heights).max(axis=1) < 1e-5] = flesh
    return colours
