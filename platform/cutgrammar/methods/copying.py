"""The control `copy`, which cuts along the planes on which the goal's fragments touch and learns nothing.

It measures how much of a goal is given away by its layout. Of the planes that divide a current fragment, it takes the
one whose contacts cover most of the fragment's section: a plane that is covered by contacts is one that may be cut
through, and a plane that is covered in part was cut later, in a smaller fragment. Scattered goals have no contacts to
copy, so the method applies to goals in place only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.contacts import ContactPlane, contact_planes
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.method import Method

MIN_DEPTH = 1e-2
"""A plane divides a fragment where it leaves this much on both sides, in units of the cube root of its volume."""
MIN_COVERED = 0.05
"""A plane whose contacts cover less of a fragment's section belongs to another fragment."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A plane that divides a current fragment.

    Attributes:
        plane: the plane of contact.
        fragment: index of the current fragment.
        covered: share of the fragment's section that contacts cover.
        area: of the section [m2].
    """

    plane: ContactPlane
    fragment: int
    covered: float
    area: float


class CopyPlanner:
    """Copies the goal's planes of contact; keeps these planes and what they cover of the current fragments."""

    def __init__(self) -> None:
        self._goal: tuple[Configuration, tuple[ContactPlane, ...]] | None = None
        self._covered: dict[tuple[int, int], tuple[Mesh, Pose, tuple[float, float]]] = {}

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The plane whose contacts cover most of a current fragment's section; after a refusal the next such plane."""
        del rng
        if not all(isinstance(fragment.shape, Mesh) for fragment in (*now, *goal)):
            return Stuck("point clouds have no faces, so that no plane of contact can be copied from them")
        planes = self._planes(goal)
        if not planes:
            return Stuck("no two fragments of the goal touch on a plane")
        candidates = sorted(self._candidates(now, planes), key=_rank)
        if not candidates:
            return Stuck(f"none of the goal's {len(planes)} planes of contact divides a current fragment")
        if len(refused) >= len(candidates):
            return Stuck(f"all {len(candidates)} planes of contact that divide a current fragment were refused")
        chosen = candidates[len(refused)]
        return Cut(chosen.plane.plane_W, now[chosen.fragment].p_WC[None])

    def _planes(self, goal: Configuration) -> tuple[ContactPlane, ...]:
        if self._goal is None or self._goal[0] is not goal:
            self._goal = goal, contact_planes(goal)
            self._covered = {}
        return self._goal[1]

    def _candidates(self, now: Configuration, planes: Sequence[ContactPlane]) -> list[_Candidate]:
        covered_now: dict[tuple[int, int], tuple[Mesh, Pose, tuple[float, float]]] = {}
        found = []
        for i, fragment in enumerate(now):
            corners = fragment.X_WF.apply(fragment.mesh.vertices)
            depth = MIN_DEPTH * np.cbrt(fragment.mesh.volume)
            for j, plane in enumerate(planes):
                distances = plane.plane_W.distances(corners)
                if distances.min() > -depth or distances.max() < depth:
                    continue
                key = id(fragment.mesh), j
                area, covered = self._section(key, fragment, plane)
                covered_now[key] = fragment.mesh, fragment.X_WF, (area, covered)
                if covered >= MIN_COVERED:
                    found.append(_Candidate(plane, i, covered, area))
        self._covered = covered_now
        return found

    def _section(self, key: tuple[int, int], fragment: Fragment, plane: ContactPlane) -> tuple[float, float]:
        """The section's area and covered share (see `ContactPlane.covered`), computed once while the fragment rests."""
        known = self._covered.get(key)
        if known is not None and known[1] is fragment.X_WF:
            return known[2]
        return plane.coverage(fragment)


def _rank(candidate: _Candidate) -> tuple[float, float, float]:
    return -round(candidate.covered, 2), -round(candidate.area, 9), candidate.plane.plane_W.offset


COPY = Method(
    "copy",
    lambda _: CopyPlanner(),
    description="cuts along the planes on which the goal's fragments touch, without learning; goals in place only",
    kind="control",
    goals=("in-place",),
    position=0,
    is_deterministic=True,
)
