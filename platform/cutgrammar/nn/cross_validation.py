"""Cross-validation over groups: rows of one group, such as the cuts of one trial, are held out together."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints

Fold = tuple[Ints, Ints]
"""Row numbers to fit on, and row numbers held out."""


def grouped_folds(groups: Ints, n_folds: int, rng: np.random.Generator) -> list[Fold]:
    """Folds that never divide a group; none where there are fewer than two folds or two groups.

    This deals groups out as scikit-learn's shuffled `GroupKFold` does, but from a `Generator`, which that cannot take.

    Args:
        groups: (n,) group of each row, e.g. the number of its trial.
        n_folds: number of folds; at most one for each group is made.
        rng: deals the groups out.
    """
    names = rng.permutation(np.unique(groups))
    count = min(n_folds, len(names))
    if count < 2:
        return []
    held = [np.isin(groups, part) for part in np.array_split(names, count)]
    return [(np.flatnonzero(~rows), np.flatnonzero(rows)) for rows in held]


def held_out_sums(folds: Sequence[Fold], train: Callable[[Ints, Ints], Sequence[Any]]) -> Floats:
    """(epochs, ...) what is measured on held-out rows after each epoch of training, summed over the folds.

    Args:
        folds: at least one.
        train: trains on the first rows, and returns what it measures on the second after each epoch.
    """
    return np.asarray(sum(np.array(train(fit, held)) for fit, held in folds))


def best_epoch(losses: Sequence[float] | Floats) -> int:
    """The number, from 1, of the first epoch with the lowest loss."""
    return int(np.argmin(losses)) + 1
