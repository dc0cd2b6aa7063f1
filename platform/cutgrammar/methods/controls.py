"""The controls that stand in every table: what chance, a crude habit and the demonstration itself reach."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.fragment import Configuration, Fragment, corners_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.locating import Locator, alike_frame
from cutgrammar.methods.method import Method

RETRY_SHIFT = 0.5e-3
"""Standard deviation of the shift with which `replay` tries a refused plane again [m]."""


class RandomPlanner:
    """Cuts a fragment drawn uniformly with a plane drawn at random."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """A random cut; goal and refusals are not looked at."""
        del goal, refused
        return _cut_anyhow(now[int(rng.integers(len(now)))], rng)


class LargestPlanner:
    """Cuts the largest fragment with a plane drawn at random."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """A random cut of the largest fragment, the first of equals; goal and refusals are not looked at."""
        del goal, refused
        return _cut_anyhow(max(now, key=lambda fragment: fragment.shape.volume), rng)


@dataclass(frozen=True, eq=False)
class ReplayPlanner:
    """Carries out the cuts of a demonstration in their order, without those that were undone.

    Which cuts have been made is told by what lies there (see `Locator`). The plane is taken over through the canonical
    frame of the fragment, so the fragment may have moved. After a refusal the plane is tried again, shifted by a normal
    step of `RETRY_SHIFT`.
    """

    demonstration: Demonstration

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next cut; the goal is not looked at."""
        del goal
        made, found = self.locate(now)
        if made == len(self._locator.cuts):
            return Stuck("the demonstration has no further cut")
        cut = self._locator.cuts[made]
        if cut.fragment not in found:
            return Stuck(f"fragment {cut.fragment} of the demonstration is not there to be cut")
        fragment = now[found[cut.fragment]]
        X_FC = alike_frame(fragment.shape, self.demonstration.fragments[cut.fragment].mesh)
        plane_W = cut.plane_C.transformed(fragment.X_WF @ X_FC)
        shift = rng.normal(0.0, RETRY_SHIFT) if refused else 0.0
        return Cut(Plane(plane_W.normal, plane_W.offset + shift), fragment.p_WC[None])

    def locate(self, now: Configuration) -> tuple[int, dict[int, int]]:
        """How far the demonstration has been carried out in `now` (see `Locator.locate`)."""
        return self._locator.locate(now)

    @cached_property
    def _locator(self) -> Locator:
        return Locator(self.demonstration)


def _cut_anyhow(fragment: Fragment, rng: np.random.Generator) -> Cut:
    """A cut of `fragment` across a uniform direction, at 10 to 90 % of its extent in that direction."""
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    heights = fragment.X_WF.apply(corners_of(fragment.shape)) @ normal
    return Cut(Plane(normal, -float(rng.uniform(0.1, 0.9) * np.ptp(heights) + heights.min())), fragment.p_WC[None])


RANDOM = Method("random", lambda _: RandomPlanner(), "a random fragment, a random plane", kind="control", position=2)
LARGEST = Method(
    "largest", lambda _: LargestPlanner(), "the largest fragment, a random plane", kind="control", position=1
)
REPLAY = Method(
    "replay",
    lambda context: ReplayPlanner(context.require_demonstration()),
    "the demonstration itself: the upper bound of the metric",
    kind="oracle",
    sees_demonstration=True,
    position=3,
)
