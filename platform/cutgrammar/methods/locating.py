"""Where a demonstration stands in what lies there: how many of its cuts were made, and which fragment is which.

For the methods that are given a demonstration. Nothing is remembered of the trial; only measures of shapes are kept.
"""

from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS, canonical_frame, covariance, extents
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh, corners_of
from cutgrammar.geometry.pose import Pose

TIE_BREAK = 1e-6
"""Weight of the distance from the demonstrated place that only decides between fragments of one shape."""


class Locator:
    """Finds a demonstration's place.

    Args:
        demonstration: without what was undone.
        by_place: weight of a fragment's distance from the demonstrated place, beside that of its measures.
    """

    def __init__(self, demonstration: Demonstration, by_place: float = TIE_BREAK) -> None:
        self.demonstration = demonstration
        self._by_place = by_place
        self._seen: dict[int, tuple[Mesh | Cloud, Floats]] = {}

    @cached_property
    def cuts(self) -> tuple[DemonstratedCut, ...]:
        """The cuts that were kept, in their order."""
        return tuple(cut for cut in self.demonstration.cuts if not cut.undone)

    def locate(self, now: Configuration) -> tuple[int, dict[int, int]]:
        """How far the demonstration has been carried out in `now`.

        Compared are the stages with as many fragments as `now`, where there are some. For each, the demonstrated
        fragments are assigned to those of `now` by the differences of their canonical extents and of the cube root of
        their volume (left out where a fragment of `now` is a cloud), and of their places by the weight given; a
        fragment without counterpart costs its own size.

        Returns:
            The number of cuts made that fits best (the smallest of equals), and the index in `now` of each
            demonstrated fragment by id.
        """
        with_volume = all(isinstance(fragment.shape, Mesh) for fragment in now)
        weights = np.array([1.0, 1.0, 1.0, float(with_volume)])
        self._seen = {id(f.shape): self._seen.get(id(f.shape)) or (f.shape, measures(f.shape)) for f in now}
        seen = np.array([self._seen[id(fragment.shape)][1] for fragment in now]) * weights
        places = np.array([fragment.p_WC for fragment in now])
        stages = list(enumerate(self._stages))
        as_many = [stage for stage in stages if len(stage[1][1]) == len(now)]
        best: tuple[float, int, dict[int, int]] | None = None
        for made, (step, alive) in as_many or stages:
            known = np.array([self._known[i] for i in alive]) * weights
            there = np.array([self.demonstration.fragment_at(step, i).p_WC for i in alive])
            size = max(len(alive), len(now))
            cost = np.zeros((size, size))
            cost[: len(alive), :] = np.linalg.norm(known, axis=1)[:, None]
            cost[:, : len(now)] = np.linalg.norm(seen, axis=1)
            cost[: len(alive), : len(now)] = np.linalg.norm(known[:, None] - seen, axis=2)
            cost[: len(alive), : len(now)] += self._by_place * np.linalg.norm(there[:, None] - places, axis=2)
            rows, columns = linear_sum_assignment(cost)
            total = float(cost[rows, columns].sum())
            if best is None or total < best[0]:
                pairs = zip(rows.tolist(), columns.tolist(), strict=True)
                best = (total, made, {alive[r]: c for r, c in pairs if r < len(alive) and c < len(now)})
        assert best is not None  # there is always the stage before the first cut
        return best[1], best[2]

    @cached_property
    def _known(self) -> dict[int, Floats]:
        return {fragment.id: measures(fragment.mesh) for fragment in self.demonstration.fragments}

    @cached_property
    def _stages(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """The step, and the ids that exist then, before the first cut and after each."""
        stages = [(0, self.demonstration.alive(0))]
        for cut in self.cuts:
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


def measures(shape: Mesh | Cloud) -> Floats:
    """(4,) canonical extents and the cube root of the volume [m]."""
    axes = np.linalg.eigh(covariance(shape)).eigenvectors  # those of the canonical frame but for their signs
    return np.append(np.ptp(corners_of(shape) @ axes, axis=0), np.cbrt(shape.volume))
