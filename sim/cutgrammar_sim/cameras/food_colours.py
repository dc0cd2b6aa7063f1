"""What colours a fragment has: its skin outside, and the flesh that cuts have laid bare."""

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
"""Of every food: red, green and blue from 0 to 1."""
OTHERS = ((0.80, 0.60, 0.40), (0.96, 0.88, 0.72))
"""Of any other food."""


def foods_after(before: Configuration, foods: Sequence[str], after: Configuration) -> tuple[str, ...]:
    """What each fragment of `after` is made of, given the foods of those `before`.

    What is there in both has kept its mesh. A product is of the food of the nearest fragment that is there no more.
    """
    if len(set(foods)) == 1:
        return (foods[0],) * len(after)
    kept = [_same(fragment, before) for fragment in after]
    gone = [i for i in range(len(before)) if i not in kept] or list(range(len(before)))
    found = []
    for fragment, at in zip(after, kept, strict=True):
        if at is None:
            at = min(gone, key=lambda i: float(np.linalg.norm(before[i].p_WC - fragment.p_WC)))
        found.append(foods[at])
    return tuple(found)


def _same(fragment: Fragment, among: Configuration) -> int | None:
    for i, other in enumerate(among):
        if other.shape is fragment.shape or np.array_equal(other.mesh.vertices, fragment.mesh.vertices):
            return i
    return None


def largest_facet(start: Configuration) -> float:
    """Area of the largest flat part of any initial object [m2]: what is larger later was laid bare by a cut.

    Two triangles may always lie in one plane; what is larger is a facet, if it has a share of the surface at all.
    """
    flat = [facet.area for fragment in start for facet in facets_of(fragment.mesh)[:1]]
    sides = [fragment.mesh.triangles for fragment in start]
    flat += [float(np.linalg.norm(np.cross(s[:, 1] - s[:, 0], s[:, 2] - s[:, 0]), axis=1).max()) for s in sides]
    return max(flat, default=0.0)


def colours_of(mesh: Mesh, food: str, largest: float) -> Floats:
    """(m, 3) colours of the triangles of a fragment; flat parts of more than `largest` [m2] show the flesh."""
    skin, flesh = SKIN_AND_FLESH.get(food, OTHERS)
    colours = np.broadcast_to(skin, (len(mesh.faces), 3)).copy()
    for facet in facets_of(mesh):
        if facet.area > 1.05 * largest:
            heights = mesh.triangles @ facet.plane_F.normal + facet.plane_F.offset
            colours[np.abs(heights).max(axis=1) < 1e-5] = flesh
    return colours
