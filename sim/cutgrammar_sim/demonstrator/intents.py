"""The intents of demonstrated cuts: the axis and the share of the extent at which each cut was planned.

Intents are inferred from the demonstrated tree by inverting the planning of `scripted_cuts`. If a fragment becomes n
fragments along an axis of the object's frame F, the plane's share of the extent is the number of fragments below it,
divided by n. A fragment with several categories is cut across into regions of equal length. If there are several
products on one side of the plane, the largest is used.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane

MAX_TILT_DEG = 15.0
"""Maximum tilt of a demonstrated plane that counts as perpendicular to an axis of F [degrees]."""
MAX_MISS = 0.7
"""Maximum distance of a demonstrated plane from its inferred place, in units of the spacing."""


@dataclass(frozen=True)
class Intent:
    """A cut across `axis` of F (0, 1, 2) at `below` / `total` of the fragment's extent."""

    axis: int
    below: int
    total: int


def intents_of(demonstration: Demonstration) -> Mapping[int, Intent | None]:
    """The intent of every cut that was kept, by its step; None if it cannot be inferred."""
    tree = _Tree(demonstration)
    return {cut.step: tree.intent(cut) for cut in tree.cuts.values()}


def plane_in_frame(cut: DemonstratedCut, mesh: Mesh) -> Plane:
    """The demonstrated plane in the frame F of the fragment that it cut, given its mesh."""
    return cut.plane_C.transformed(canonical_frame(mesh))


class _Tree:
    """The demonstrated tree, with counts of fragments along the axes of F."""

    def __init__(self, demonstration: Demonstration) -> None:
        self.fragments = demonstration.fragments
        self.cuts = {cut.fragment: cut for cut in demonstration.cuts if not cut.undone}
        self.planes = {i: plane_in_frame(cut, self.fragments[i].mesh) for i, cut in self.cuts.items()}

    def intent(self, cut: DemonstratedCut) -> Intent | None:
        plane = self.planes[cut.fragment]
        axis = _axis_of(plane)
        if abs(plane.normal[axis]) < np.cos(np.radians(MAX_TILT_DEG)):
            return None
        sides = self._sides(cut.fragment)
        if sides is None:
            return None
        categories = [self._categories(side) for side in sides]
        if len(categories[0] | categories[1]) > 1 and not categories[0] & categories[1]:
            below, above = (len(side) for side in categories)
        else:
            below, above = (self._count(side, axis) for side in sides)
        intent = Intent(axis, below, below + above)
        return intent if _miss(plane, self.fragments[cut.fragment].mesh, intent) <= MAX_MISS else None

    def _sides(self, fragment: int) -> tuple[int, int] | None:
        """The largest products below and above the plane along its axis; None if one side is empty."""
        plane = self.planes[fragment]
        up = np.sign(plane.normal[_axis_of(plane)])
        products = self.cuts[fragment].products
        heights = {i: up * float(plane.distances(self.fragments[i].mesh.centroid)) for i in products}
        below, above = ([i for i in products if (heights[i] > 0.0) == side] for side in (False, True))
        if not below or not above:
            return None
        return max(below, key=self._volume), max(above, key=self._volume)

    def _volume(self, fragment: int) -> float:
        return self.fragments[fragment].mesh.volume

    def _categories(self, fragment: int) -> set[str | None]:
        """The categories of the goal fragments that come from this fragment."""
        if fragment not in self.cuts:
            return {self.fragments[fragment].category}
        return set().union(*(self._categories(i) for i in self.cuts[fragment].products))

    def _count(self, fragment: int, axis: int) -> int:
        """The number of goal fragments along `axis` that come from this fragment."""
        if fragment not in self.cuts:
            return 1
        sides = self._sides(fragment)
        if sides is None:
            return 1
        counts = [self._count(side, axis) for side in sides]
        return sum(counts) if _axis_of(self.planes[fragment]) == axis else max(counts)


def _axis_of(plane: Plane) -> int:
    return int(np.argmax(np.abs(plane.normal)))


def _miss(plane: Plane, mesh: Mesh, intent: Intent) -> float:
    """Distance of the plane from the intended place at the centre of the mesh's box, in units of the spacing."""
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    spacing = (highest[intent.axis] - lowest[intent.axis]) / intent.total
    point: Floats = (lowest + highest) / 2.0
    point[intent.axis] = lowest[intent.axis] + spacing * intent.below
    return abs(float(plane.distances(point)) / float(plane.normal[intent.axis] * spacing))
