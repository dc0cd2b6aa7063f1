"""The training corpus of grammar induction (II-B): the features of fragments, and the products of each cut."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints, frozen_floats, frozen_ints
from cutgrammar.grammar.production import Production


@dataclass(frozen=True, eq=False)
class Corpus:
    """Training fragments and cuts; fragments are identified by their index.

    Attributes:
        features: (n, 17) shape feature z of every fragment, including whole objects.
        trials: (n,) the trial that each fragment comes from.
        cuts: (fragment cut, its products) for every cut that was kept.

    Raises:
        ValueError: there is no cut; a cut has an invalid index, fewer than two products or fragments of several trials;
            or a fragment is cut twice or is a product of two cuts.
    """

    features: Floats
    trials: Ints
    cuts: tuple[tuple[int, tuple[int, ...]], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", frozen_floats(self.features, (None, None), "features"))
        object.__setattr__(self, "trials", frozen_ints(self.trials, (len(self.features),), "trials"))
        object.__setattr__(self, "cuts", tuple((int(cut), tuple(map(int, products))) for cut, products in self.cuts))
        if not self.cuts:
            raise ValueError("a corpus needs at least one cut")
        for cut, products in self.cuts:
            indices = np.array([cut, *products])
            exist = indices.min() >= 0 and indices.max() < len(self.trials)
            if len(products) < 2 or not exist or np.ptp(self.trials[indices]) != 0:
                raise ValueError(
                    f"cut {cut} -> {products} does not divide one fragment into two or more of the same trial"
                )
        for role, ids in (
            ("cut", [c for c, _ in self.cuts]),
            ("produced", [i for _, products in self.cuts for i in products]),
        ):
            if len(set(ids)) != len(ids):
                raise ValueError(f"a fragment is {role} twice")

    def __reduce__(self) -> tuple[Any, ...]:
        return Corpus, (self.features, self.trials, self.cuts)

    def productions(self, types: Ints) -> list[Production]:
        """D_c^k: the production of each cut if the fragments have these types (n,)."""
        return [Production(int(types[cut]), tuple(int(types[i]) for i in products)) for cut, products in self.cuts]

    def of_trials(self, trials: Ints) -> "Corpus":
        """The sub-corpus of these trials, with its fragments renumbered.

        Raises:
            ValueError: it has no cut.
        """
        kept = np.flatnonzero(np.isin(self.trials, trials))
        new_index = {int(old): i for i, old in enumerate(kept)}
        cuts = tuple(
            (new_index[cut], tuple(new_index[i] for i in products)) for cut, products in self.cuts if cut in new_index
        )
        return Corpus(self.features[kept], self.trials[kept], cuts)
