"""The fragments of training trials: which there are, and their meshes, which are looked up when they are needed.

The meshes of a large data set do not fit into memory; their features do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.geometry.fragment import Mesh


class FragmentMeshes(Sequence[Mesh]):
    """The meshes of fragments of demonstrations; iterating takes one demonstration after another.

    Args:
        demonstrations: of the trials, perhaps read one by one.
        places: of each fragment, the position of its demonstration and its id there.
    """

    def __init__(self, demonstrations: Sequence[Demonstration], places: Sequence[tuple[int, int]]) -> None:
        self._demonstrations, self._places = demonstrations, places

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Mesh]:
        position, demonstration = -1, None
        for place, fragment in self._places:
            if demonstration is None or place != position:
                position, demonstration = place, self._demonstrations[place]
            yield demonstration.fragments[fragment].mesh

    @overload
    def __getitem__(self, index: int) -> Mesh: ...
    @overload
    def __getitem__(self, index: slice) -> "FragmentMeshes": ...
    def __getitem__(self, index: int | slice) -> "Mesh | FragmentMeshes":
        """The mesh of a fragment, or those of some."""
        if isinstance(index, slice):
            return FragmentMeshes(self._demonstrations, self._places[index])
        place, fragment = self._places[index]
        return self._demonstrations[place].fragments[fragment].mesh


@dataclass(frozen=True, eq=False)
class TrainingFragments:
    """The fragments and cuts of all demonstrations, with fragments numbered from 0.

    Attributes:
        meshes: of every fragment.
        trials: (n,) the trial of each fragment.
        cuts: (fragment cut, fragments it became, the cut) of every cut that was not undone.
    """

    meshes: Sequence[Mesh]
    trials: tuple[int, ...]
    cuts: tuple[tuple[int, tuple[int, ...], DemonstratedCut], ...]


def training_fragments(demonstrations: Sequence[Demonstration]) -> TrainingFragments:
    """The fragments and cuts of `demonstrations`, without undone cuts and what only they made."""
    places: list[tuple[int, int]] = []
    trials: list[int] = []
    cuts: list[tuple[int, tuple[int, ...], DemonstratedCut]] = []
    for position, demonstration in enumerate(demonstrations):
        kept = [cut for cut in demonstration.cuts if not cut.undone]
        ids = sorted(set(demonstration.alive(0)).union(*(cut.products for cut in kept)))
        number = {fragment: len(places) + i for i, fragment in enumerate(ids)}
        places += [(position, fragment) for fragment in ids]
        trials += [demonstration.trial] * len(ids)
        cuts += [(number[cut.fragment], tuple(number[made] for made in cut.products), cut) for cut in kept]
    return TrainingFragments(FragmentMeshes(demonstrations, places), tuple(trials), tuple(cuts))
