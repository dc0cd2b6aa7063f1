"""`copy`: cuts along the planes on which the goal's fragments touch, where they lie; no learning at all.

It tells how much of a goal its layout gives away. Of the planes that divide a current fragment, that is taken whose
contacts cover most of the fragment's section: a plane that the goal's fragments touch on all over is one that may be
cut through, one that they touch on in part was cut later, in a smaller fragment. Where the goal's fragments lie
scattered there is nothing to copy, so it declares the goals that it applies to.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.contacts import ContactPlane, contact_planes
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.method import Method

LEAST_DEPTH = 1e-2
"""A plane divides a fragment where it leaves this much on both sides, in units of the cube root of its volume."""
LEAST_COVERED = 0.05
"""A plane whose contacts cover less of a fragment's section belongs to another fragment."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A plane that divides a current fragment: the share of its section that is covered, and the section's area."""

    plane: ContactPlane
    fragment: int
    covered: float
    area: float


class CopyPlanner:
    """Copies the goal's planes of contact; keeps those of the goal and what they cover of fragments seen."""

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
        there: dict[tuple[int, int], tuple[Mesh, Pose, tuple[float, float]]] = {}
        found = []
        for i, fragment in enumerate(now):
            corners = fragment.X_WF.apply(fragment.mesh.vertices)
            depth = LEAST_DEPTH * np.cbrt(fragment.mesh.volume)
            for j, plane in enumerate(planes):
                distances = plane.plane_W.distances(corners)
                if distances.min() > -depth or distances.max() < depth:
                    continue
                key = id(fragment.mesh), j
                there[key] = fragment.mesh, fragment.X_WF, self._section(key, fragment, plane)
                area, covered = there[key][2]
                if covered >= LEAST_COVERED:
                    found.append(_Candidate(plane, i, covered, area))
        self._covered = there
        return found

    def _section(self, key: tuple[int, int], fragment: Fragment, plane: ContactPlane) -> tuple[float, float]:
        """What `ContactPlane.covered` says, found out once while the fragment stays where it is."""
        known = self._covered.get(key)
        if known is not None and known[1] is fragment.X_WF:
            return known[2]
        return plane.covered(fragment)


def _rank(candidate: _Candidate) -> tuple[float, float, float]:
    return -round(candidate.covered, 2), -round(candidate.area, 9), candidate.plane.plane_W.offset


COPY = Method(
    "copy",
    lambda _: CopyPlanner(),
    "cuts along the planes on which the goal's fragments touch, without learning; goals in place only",
    kind="control",
    goals=("in-place",),
    position=0,
)
