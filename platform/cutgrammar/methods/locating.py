"""How far a demonstration has been carried out in a configuration, and which fragment corresponds to which.

Methods that follow a demonstration use it. They keep no memory of the trial and locate everything from the current
fragments, so a cut with another result does not mislead them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import covariance
from cutgrammar.geometry.fragment import Cloud, Configuration, Fragment, Mesh, vertices_of
from cutgrammar.interfaces import Stuck
from cutgrammar.methods.shape_cache import ShapeCache

TIE_BREAK = 1e-6
"""Weight of the distance from the demonstrated position that decides only between fragments of equal shape."""


@dataclass(frozen=True, eq=False)
class NextCut:
    """The demonstration's next cut.

    Attributes:
        cut: the cut as it was demonstrated.
        fragment: the current fragment that corresponds to the one it cut.
        model: mesh of the demonstrated fragment.
    """

    cut: DemonstratedCut
    fragment: Fragment
    model: Mesh


class Locator:
    """Finds how far a demonstration has been carried out; cuts that were undone do not count.

    Args:
        demonstration: the demonstration that is followed.
        place_weight: weight of a fragment's distance from its demonstrated position; its measures have weight 1.
    """

    def __init__(self, demonstration: Demonstration, place_weight: float = TIE_BREAK) -> None:
        self._demonstration = demonstration
        self._place_weight = place_weight
        self._measures = ShapeCache(measures)

    @cached_property
    def cuts(self) -> tuple[DemonstratedCut, ...]:
        """The cuts that were not undone, in their order."""
        return tuple(cut for cut in self._demonstration.cuts if not cut.undone)

    def next_cut(self, now: Configuration, exhausted: str = "the demonstration has no further cut") -> NextCut | Stuck:
        """The next cut of the demonstration in the configuration `now`.

        Args:
            now: the current fragments.
            exhausted: the reason given where all cuts have been made.
        """
        made, index = self.locate(now)
        if made == len(self.cuts):
            return Stuck(exhausted)
        cut = self.cuts[made]
        if cut.fragment not in index:
            return Stuck(f"fragment {cut.fragment} of the demonstration is not there to be cut")
        return NextCut(cut, now[index[cut.fragment]], self._demonstration.fragments[cut.fragment].mesh)

    def locate(self, now: Configuration) -> tuple[int, dict[int, int]]:
        """How far the demonstration has been carried out in `now`.

        The stages with the same number of fragments as `now` are compared, or all stages if none has it. For each, the
        demonstrated fragments are assigned to those of `now` by the differences of their canonical extents, of the
        cube root of their volume (unless a fragment of `now` is a cloud), and of their positions times `place_weight`.
        A fragment without counterpart costs its own size.

        Returns:
            The number of cuts made that fits best (the smallest of equals), and the index in `now` of each
            demonstrated fragment by id.
        """
        with_volume = all(isinstance(fragment.shape, Mesh) for fragment in now)
        weights = np.array([1.0, 1.0, 1.0, float(with_volume)])
        observed = self._measures(now)[0] * weights
        places = np.array([fragment.p_WC for fragment in now])
        stages = list(enumerate(self._stages))
        same_number = [stage for stage in stages if len(stage[1][1]) == len(now)]
        best: tuple[float, int, dict[int, int]] | None = None
        for made, (step, alive) in same_number or stages:
            demonstrated = np.array([self._demonstrated_measures[i] for i in alive]) * weights
            demonstrated_places = np.array([self._demonstration.fragment_at(step, i).p_WC for i in alive])
            size = max(len(alive), len(now))
            cost = np.zeros((size, size))
            cost[: len(alive), :] = np.linalg.norm(demonstrated, axis=1)[:, None]
            cost[:, : len(now)] = np.linalg.norm(observed, axis=1)
            distances = np.linalg.norm(demonstrated_places[:, None] - places, axis=2)
            cost[: len(alive), : len(now)] = np.linalg.norm(demonstrated[:, None] - observed, axis=2)
            cost[: len(alive), : len(now)] += self._place_weight * distances
            rows, columns = linear_sum_assignment(cost)
            total = float(cost[rows, columns].sum())
            if best is None or total < best[0]:
                pairs = zip(rows.tolist(), columns.tolist(), strict=True)
                best = (total, made, {alive[r]: c for r, c in pairs if r < len(alive) and c < len(now)})
        assert best is not None  # there is always the stage before the first cut
        return best[1], best[2]

    @cached_property
    def _demonstrated_measures(self) -> dict[int, Floats]:
        return {fragment.id: measures(fragment.mesh) for fragment in self._demonstration.fragments}

    @cached_property
    def _stages(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """The step and the ids of its fragments, before the first cut and after each."""
        stages = [(0, self._demonstration.alive(0))]
        for cut in self.cuts:
            uncut = tuple(i for i in stages[-1][1] if i != cut.fragment)
            stages.append((cut.step, uncut + cut.products))
        return tuple(stages)


def measures(shape: Mesh | Cloud) -> Floats:
    """(4,) canonical extents and the cube root of the volume [m]."""
    axes = np.linalg.eigh(covariance(shape)).eigenvectors  # of the canonical frame, except for their signs
    return np.append(np.ptp(vertices_of(shape) @ axes, axis=0), np.cbrt(shape.volume))
