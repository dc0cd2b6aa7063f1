"""The corpus that a grammar is induced from (II-B): fragments with their features, and what each cut made of one."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats
from cutgrammar.grammar.production import Production


@dataclass(frozen=True, eq=False)
class Corpus:
    """Training fragments and cuts; fragments are known by their index.

    Attributes:
        features: (n, 17) shape feature z of every fragment, whole objects included.
        trials: (n,) the trial that each fragment comes from.
        cuts: (fragment cut, fragments it became) of every cut that was kept.

    Raises:
        ValueError: no cut, a cut that names no fragment, makes fewer than two or spans trials, or a fragment that is
            cut twice or comes from two cuts.
    """

    features: Floats
    trials: Ints
    cuts: tuple[tuple[int, tuple[int, ...]], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", frozen_floats(self.features, (None, None), "features"))
        trials = np.array(self.trials, dtype=np.int64)
        trials.setflags(write=False)
        object.__setattr__(self, "trials", trials)
        object.__setattr__(self, "cuts", tuple((int(cut), tuple(map(int, made))) for cut, made in self.cuts))
        if trials.shape != (len(self.features),):
            raise ValueError(f"{len(self.features)} fragments have trials of shape {trials.shape}")
        if not self.cuts:
            raise ValueError("a corpus without cuts holds no production")
        for cut, made in self.cuts:
            named = np.array([cut, *made])
            if len(made) < 2 or named.min() < 0 or named.max() >= len(trials) or np.ptp(trials[named]) != 0:
                raise ValueError(f"cut {cut} -> {made} is not one fragment made into two or more in one trial")
        for role, ids in (("cut", [c for c, _ in self.cuts]), ("made", [i for _, made in self.cuts for i in made])):
            if len(set(ids)) != len(ids):
                raise ValueError(f"a fragment is {role} twice")

    def __reduce__(self) -> tuple[Any, ...]:
        return Corpus, (self.features, self.trials, self.cuts)

    def productions(self, types: Ints) -> list[Production]:
        """D_c^k: what each cut is once fragments are known by their types (n,) only."""
        return [Production(int(types[cut]), tuple(int(types[i]) for i in made)) for cut, made in self.cuts]

    def of_trials(self, trials: Ints) -> "Corpus":
        """The part that comes from these trials, its fragments numbered anew.

        Raises:
            ValueError: it holds no cut.
        """
        kept = np.flatnonzero(np.isin(self.trials, trials))
        new = {int(old): i for i, old in enumerate(kept)}
        cuts = tuple((new[cut], tuple(new[i] for i in made)) for cut, made in self.cuts if cut in new)
        return Corpus(self.features[kept], self.trials[kept], cuts)
