"""The controls `random` and `largest`, and `replay`, which carries out the demonstration itself."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.fragment import Configuration, Fragment, vertices_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.alignment import aligned_canonical_frame
from cutgrammar.methods.halving import cut_across
from cutgrammar.methods.locating import Locator
from cutgrammar.methods.method import Method

MIDDLE = (0.1, 0.9)
"""The range, as shares of a fragment's extent, from which `random` and `largest` draw a plane's position."""
RETRY_SHIFT = 0.5e-3
"""Standard deviation of the shift with which `replay` tries a refused plane again [m]."""


class RandomPlanner:
    """Cuts a fragment drawn uniformly with a plane drawn at random."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """A random cut; goal and refusals are ignored."""
        del goal, refused
        return _random_cut(now[int(rng.integers(len(now)))], rng)


class LargestPlanner:
    """Cuts the fragment of largest volume across its longest canonical axis, at a position drawn uniformly.

    The position lies within the middle `MIDDLE` of the fragment's extent along that axis, as it does for `random`.
    """

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """A cut across the largest fragment, the first of equals; goal and refusals are ignored."""
        del goal, refused
        return cut_across(max(now, key=lambda fragment: fragment.shape.volume), float(rng.uniform(*MIDDLE)))


class ReplayPlanner:
    """Carries out the cuts of a demonstration in their order, without those that were undone.

    `Locator` finds the next cut from the current fragments. The plane is carried over by the canonical frame of the
    fragment, so the fragment may have moved. After a refusal the plane is tried again, shifted by a normal step of
    `RETRY_SHIFT`.
    """

    def __init__(self, demonstration: Demonstration) -> None:
        self._locator = Locator(demonstration)

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next cut; the goal is ignored."""
        del goal
        following = self._locator.next_cut(now)
        if isinstance(following, Stuck):
            return following
        fragment = following.fragment
        X_FC = aligned_canonical_frame(fragment.shape, following.model)
        plane_W = following.cut.plane_C.transformed(fragment.X_WF @ X_FC)
        shift = rng.normal(0.0, RETRY_SHIFT) if refused else 0.0
        return Cut(Plane(plane_W.normal, plane_W.offset + shift), fragment.p_WC[None])


def _random_cut(fragment: Fragment, rng: np.random.Generator) -> Cut:
    """A cut of `fragment` across a uniform direction, at a position within `MIDDLE` of its extent in that direction."""
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    heights = fragment.X_WF.apply(vertices_of(fragment.shape)) @ normal
    return Cut(Plane(normal, -float(rng.uniform(*MIDDLE) * np.ptp(heights) + heights.min())), fragment.p_WC[None])


RANDOM = Method(
    "random", lambda _: RandomPlanner(), description="a random fragment, a random plane", kind="control", position=4
)
LARGEST = Method(
    "largest",
    lambda _: LargestPlanner(),
    description="the largest fragment, cut across its long axis at a random position",
    kind="control",
    position=3,
)
REPLAY = Method(
    "replay",
    lambda context: ReplayPlanner(context.require_demonstration()),
    description="the demonstration itself: the upper bound of the metric",
    kind="oracle",
    sees_demonstration=True,
    position=3,
    is_deterministic=True,
)
