"""The control `peel`: shave off a product that is shaped like a fragment of the goal, or else halve.

It learns nothing: it compares the goal's fragments with what each current fragment could lose in one cut. What plans by
a learned grammar should do better. Only volumes and canonical extents (III-D) are used, so the goal may lie anywhere.

1. Current fragments are assigned to the goal's by the overlap of their canonical boxes. One that has about the volume
   of its goal fragment is finished; the others are open, and so are the goal's fragments left.
2. For every open fragment, every goal fragment left, every canonical axis and both ends, the plane across that axis is
   found that cuts off exactly the goal fragment's volume. Its score is the overlap of the canonical boxes of the
   product and the goal fragment. If the remainder could only become one fragment, its own best overlap counts as much.
3. The best such plane is cut. If none reaches `MIN_OVERLAP`, the longest open fragment is halved as `halve` does.

A point cloud is replaced by its convex hull, which is also what its volume is taken from. Nothing is drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Cloud, Configuration, Fragment, Mesh
from cutgrammar.geometry.partial_volume import height_of_volume, part_below
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.halving import halving_cuts
from cutgrammar.methods.method import Method
from cutgrammar.perception.vision.convex_parts import hull

MIN_OVERLAP = 0.6
"""A product whose box overlaps that of the goal fragment by less is not cut off."""
MAX_EXCESS = 1.3
"""A current fragment with up to this many times the volume of its goal fragment is finished, unless all are."""
DECIMALS = 6
"""Overlaps that are equal to this many decimals count as equal; the plane that is found first then wins."""


@dataclass(frozen=True, eq=False)
class _Measured:
    """What is compared of a shape: volume [m3], canonical extents (3,) [m], and its triangles (m, 3, 3) in C [m]."""

    volume: float
    extents: Floats
    triangles: Floats


@dataclass(frozen=True, eq=False)
class _Peel:
    """A plane across a canonical axis of a current fragment that cuts off one of the goal's fragments."""

    fragment: Fragment
    axis: int
    height: float
    overlap: float

    @property
    def cut(self) -> Cut:
        normal: Floats = np.eye(3)[self.axis]
        return Cut.of_fragment(self.fragment, Plane(normal, -self.height), canonical_frame(self.fragment.shape))


class PeelPlanner:
    """Peels off what is shaped like a fragment of the goal; keeps the measures and planes of fragments that remain."""

    def __init__(self) -> None:
        self._measured: dict[int, tuple[Mesh | Cloud, _Measured]] = {}
        self._parts: dict[tuple[int, int], list[tuple[int, float, float, Floats]]] = {}

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The best cut; after each refusal the next best. No random numbers are used."""
        del rng
        if len(now) >= len(goal):
            return Stuck(f"there are {len(now)} fragments already and the goal has {len(goal)}")
        current, wanted = self._measure(now), self._measure(goal)
        open_now, open_goal = _left(current, wanted)
        peels = self._peels([(now[i], current[i]) for i in open_now], [wanted[j] for j in open_goal])
        if len(refused) < len(peels):
            return peels[len(refused)].cut
        beyond = len(refused) - len(peels)
        for cut in islice(halving_cuts([now[i] for i in open_now]), beyond, None):
            return cut
        return Stuck(f"all {len(refused)} planes across the {len(open_now)} fragments left to cut were refused")

    def _measure(self, configuration: Configuration) -> list[_Measured]:
        for fragment in configuration:
            shape = fragment.shape
            if id(shape) not in self._measured:
                self._measured[id(shape)] = shape, _measures(shape)
        return [self._measured[id(fragment.shape)][1] for fragment in configuration]

    def _peels(self, fragments: Sequence[tuple[Fragment, _Measured]], goal: Sequence[_Measured]) -> list[_Peel]:
        """The planes that cut off a product which overlaps a goal fragment well enough, best first."""
        found = []
        for fragment, measured in fragments:
            for wanted in goal:
                others = [other for other in goal if other is not wanted]
                for axis, height, rest_volume, boxes in self._planes(measured, wanted):
                    overlap = box_overlap(boxes[0], wanted.extents)
                    single = [g for g in others if rest_volume <= MAX_EXCESS * g.volume]
                    if single:
                        overlap = (overlap + max(box_overlap(boxes[1], g.extents) for g in single)) / 2.0
                    if overlap >= MIN_OVERLAP:
                        found.append(_Peel(fragment, axis, height, round(overlap, DECIMALS)))
        return sorted(found, key=lambda peel: -peel.overlap)

    def _planes(self, measured: _Measured, wanted: _Measured) -> list[tuple[int, float, float, Floats]]:
        """For every axis and end: axis, height, volume of the rest [m3] and extents (2, 3) of product and rest [m]."""
        key = id(measured), id(wanted)
        if key not in self._parts:
            self._parts[key] = [
                plane for axis in range(3) for sign in (1.0, -1.0) if (plane := _plane(measured, wanted, axis, sign))
            ]
        return self._parts[key]


def _plane(measured: _Measured, wanted: _Measured, axis: int, sign: float) -> tuple[int, float, float, Floats] | None:
    """The plane across `axis` that cuts off the volume wanted, from below (`sign` 1) or from above (-1)."""
    rest = measured.volume - wanted.volume
    if rest <= 0.0:
        return None
    upside_down = np.ones(3)
    upside_down[[axis, (axis + 1) % 3]] = -1.0
    above = measured.triangles * upside_down
    below, above = (measured.triangles, above) if sign > 0.0 else (above, measured.triangles)
    height = height_of_volume(below, axis, wanted.volume)
    product, remainder = part_below(below, axis, height), part_below(above, axis, -height)
    if product is None or remainder is None:
        return None
    return axis, sign * height, rest, np.array([product.extents, remainder.extents])


def _left(current: Sequence[_Measured], goal: Sequence[_Measured]) -> tuple[list[int], list[int]]:
    """The indices of the current fragments left to cut, and of the goal's fragments left to make."""
    overlaps = np.array([[box_overlap(a.extents, b.extents) for b in goal] for a in current])
    rows, columns = linear_sum_assignment(overlaps, maximize=True)
    excess = {i: current[i].volume / goal[j].volume for i, j in zip(rows.tolist(), columns.tolist(), strict=True)}
    open_now = [i for i in excess if excess[i] > MAX_EXCESS] or [max(excess, key=lambda i: excess[i])]
    finished = {j for i, j in zip(rows.tolist(), columns.tolist(), strict=True) if i not in open_now}
    return open_now, [j for j in range(len(goal)) if j not in finished]


def box_overlap(a: Floats, b: Floats) -> float:
    """Intersection over union of two boxes with sides a, b (3,) and a common centre."""
    shared = float(np.minimum(a, b).prod())
    return shared / (float(a.prod()) + float(b.prod()) - shared)


def _measures(shape: Mesh | Cloud) -> _Measured:
    """The measures of a mesh, or of a cloud's convex hull in the canonical frame of the cloud.

    Raises:
        ValueError: the points of a cloud lie in a plane.
    """
    X_FC = canonical_frame(shape)
    solid = hull(shape.points) if isinstance(shape, Cloud) else shape
    if solid is None:
        raise ValueError("the points of a cloud lie in a plane and enclose no volume")
    low, high = extents(shape, X_FC)
    return _Measured(solid.volume, high - low, np.ascontiguousarray(solid.moved(X_FC.inverse()).triangles))


PEEL = Method(
    "peel",
    lambda _: PeelPlanner(),
    description="shaves off a product shaped like a fragment of the goal, or else halves; learns nothing",
    kind="control",
    position=1,
    is_deterministic=True,
)
