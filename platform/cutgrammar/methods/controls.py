"""The controls that stand in every table: what chance, a crude habit and the demonstration itself reach."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.demonstrations import DemonstratedCut, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS, canonical_frame, extents
from cutgrammar.geometry.fragment import Cloud, Configuration, Fragment, Mesh, corners_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.seams import Cut, Refusal, Spread, Stuck, here
from cutgrammar.settings import Settings

if TYPE_CHECKING:
    from cutgrammar.methods.model import Model

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

    It keeps no memory of the trial: which cuts have been made is told by which set of demonstrated fragments resembles
    the current ones most. The plane is taken over through the canonical frame of the fragment, so the fragment may
    have moved. After a refusal the plane is tried again, shifted by a normal step of `RETRY_SHIFT`.
    """

    demonstration: Demonstration

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next cut; the goal is not looked at."""
        del goal
        made, found = self.locate(now)
        if made == len(self._cuts):
            return Stuck("the demonstration has no further cut")
        cut = self._cuts[made]
        if cut.fragment not in found:
            return Stuck(f"fragment {cut.fragment} of the demonstration is not there to be cut")
        fragment = now[found[cut.fragment]]
        X_FC = alike_frame(fragment.shape, self.demonstration.fragments[cut.fragment].mesh)
        plane_W = cut.plane_C.seen_from(fragment.X_WF @ X_FC)
        shift = rng.normal(0.0, RETRY_SHIFT) if refused else 0.0
        return Cut(Plane(plane_W.normal, plane_W.offset + shift), fragment.p_WC[None])

    def locate(self, now: Configuration) -> tuple[int, dict[int, int]]:
        """How far the demonstration has been carried out in `now`.

        For each number of cuts made, the demonstrated fragments are assigned to those of `now` by the differences of
        their canonical extents and of the cube root of their volume (left out where a fragment of `now` is a cloud); a
        fragment without counterpart costs its own size. Between fragments of one shape the distance of their centroids
        from the demonstrated ones decides, with a weight of 1e-6.

        Returns:
            The number of cuts made that fits best (the smallest of equals), and the index in `now` of each
            demonstrated fragment by id.
        """
        with_volume = all(isinstance(fragment.shape, Mesh) for fragment in now)
        weights = np.array([1.0, 1.0, 1.0, float(with_volume)])
        seen = np.array([_measures(fragment.shape) for fragment in now]) * weights
        places = np.array([fragment.p_WC for fragment in now])
        best: tuple[float, int, dict[int, int]] | None = None
        for made, (step, alive) in enumerate(self._stages):
            known = np.array([self._known[i] for i in alive]) * weights
            there = np.array([self.demonstration.fragment_at(step, i).p_WC for i in alive])
            size = max(len(alive), len(now))
            cost = np.zeros((size, size))
            cost[: len(alive), :] = np.linalg.norm(known, axis=1)[:, None]
            cost[:, : len(now)] = np.linalg.norm(seen, axis=1)
            cost[: len(alive), : len(now)] = np.linalg.norm(known[:, None] - seen, axis=2)
            cost[: len(alive), : len(now)] += 1e-6 * np.linalg.norm(there[:, None] - places, axis=2)
            rows, columns = linear_sum_assignment(cost)
            total = float(cost[rows, columns].sum())
            if best is None or total < best[0]:
                pairs = zip(rows.tolist(), columns.tolist(), strict=True)
                best = (total, made, {alive[r]: c for r, c in pairs if r < len(alive) and c < len(now)})
        assert best is not None  # there is always the stage before the first cut
        return best[1], best[2]

    @cached_property
    def _cuts(self) -> tuple[DemonstratedCut, ...]:
        return tuple(cut for cut in self.demonstration.cuts if not cut.undone)

    @cached_property
    def _known(self) -> dict[int, Floats]:
        return {fragment.id: _measures(fragment.mesh) for fragment in self.demonstration.fragments}

    @cached_property
    def _stages(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """The step, and the ids that exist then, before the first cut and after each."""
        stages = [(0, self.demonstration.alive(0))]
        for cut in self._cuts:
            left = tuple(i for i in stages[-1][1] if i != cut.fragment)
            stages.append((cut.step, left + cut.products))
        return tuple(stages)


def alike_frame(shape: Mesh | Cloud, model: Mesh) -> Pose:
    """X_FC: the canonical frame of `shape`, with the signs of its axes that make its box most like that of `model`."""
    X_FC = canonical_frame(shape)
    low, high = extents(model, canonical_frame(model))

    def misfit(flip: Pose) -> float:
        seen = extents(shape, X_FC @ flip)
        return round(float(np.abs(seen[0] - low).max() + np.abs(seen[1] - high).max()), 7)

    return X_FC @ min(FLIPS, key=misfit)


def _cut_anyhow(fragment: Fragment, rng: np.random.Generator) -> Cut:
    """A cut of `fragment` across a uniform direction, at 10 to 90 % of its extent in that direction."""
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    heights = fragment.X_WF.apply(corners_of(fragment.shape)) @ normal
    return Cut(Plane(normal, -float(rng.uniform(0.1, 0.9) * np.ptp(heights) + heights.min())), fragment.p_WC[None])


def _measures(shape: Mesh | Cloud) -> Floats:
    """(4,) canonical extents and the cube root of the volume [m]."""
    low, high = extents(shape, canonical_frame(shape))
    return np.append(high - low, np.cbrt(shape.volume))


def make_random(
    model: "Model | None", settings: Settings, demonstration: Demonstration | None = None, spread: Spread = here
) -> RandomPlanner:
    """A planner that needs none of what it is given."""
    del model, settings, demonstration, spread
    return RandomPlanner()


def make_largest(
    model: "Model | None", settings: Settings, demonstration: Demonstration | None = None, spread: Spread = here
) -> LargestPlanner:
    """A planner that needs none of what it is given."""
    del model, settings, demonstration, spread
    return LargestPlanner()


def make_replay(
    model: "Model | None", settings: Settings, demonstration: Demonstration | None = None, spread: Spread = here
) -> ReplayPlanner:
    """A planner that is given the demonstration; it needs neither model nor settings.

    Raises:
        ValueError: no demonstration.
    """
    del model, settings, spread
    if demonstration is None:
        raise ValueError("replay carries out a demonstration and was given none; it declares sees_demonstration")
    return ReplayPlanner(demonstration)


make_replay.__dict__["sees_demonstration"] = True
