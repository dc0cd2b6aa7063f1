"""Cross-validation over groups: rows of one group, such as the cuts of one trial, are held out together.

It measures a training, and does not choose how long it lasts (see docs/decisions.md, "the length of training").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints

T = TypeVar("T")
Fold = tuple[Ints, Ints]
"""Row numbers to fit on, and row numbers held out."""
Progress = Callable[..., Any]
"""Called with how many trainings are finished, of how many, and ((epoch, held-out loss), ...) of the last one, which is
empty where nothing was held out or what was measured is no loss."""


@dataclass(frozen=True, eq=False)
class Validated(Generic[T]):
    """A trained network and what cross-validation measured.

    Attributes:
        fitted: the network fitted to all rows.
        folds: rows to fit on and rows held out; empty where nothing could be held out.
        networks: the network fitted in each fold.
        sums: (epochs, ...) what was measured on the held-out rows after each epoch, summed over the folds.
    """

    fitted: T
    folds: Sequence[Fold]
    networks: Sequence[T]
    sums: Floats

    def losses(self, count: int) -> tuple[float, ...]:
        """The sums as means over `count` rows; empty where nothing could be held out."""
        return tuple(float(value) for value in self.sums / max(count, 1))


def fit_and_validate(
    groups: Ints,
    n_folds: int,
    rng: np.random.Generator,
    train: Callable[[Ints, Ints], tuple[T, Sequence[Any]]],
    progress: Progress | None = None,
) -> Validated[T]:
    """Train once for each fold of the groups, and once on all rows.

    Args:
        groups: (n,) group of each row, e.g. the number of its trial.
        n_folds: number of folds; fewer than two, or a single group, hold nothing out.
        rng: deals the groups out.
        train: trains on the first rows; returns the network, and what it measures on the second, perhaps none, after
            each epoch.
        progress: called with the number of finished trainings and their total.
    """
    folds = grouped_folds(groups, n_folds, rng)
    networks, measured = [], []
    for fit, held in [*folds, (np.arange(len(groups)), np.zeros(0, dtype=np.int64))]:
        network, values = train(fit, held)
        networks.append(network)
        measured.append(np.array(values))
        if progress is not None:
            progress(len(networks), len(folds) + 1, _curve(measured[-1], len(held)))
    sums = np.asarray(sum(measured[:-1])) if folds else np.zeros(0)
    return Validated(networks[-1], folds, networks[:-1], sums)


def _curve(sums: Floats, count: int) -> tuple[tuple[float, float], ...]:
    """((epoch, loss), ...) of sums (epochs,) over `count` held-out rows."""
    if not count or sums.ndim != 1:
        return ()
    return tuple((epoch, float(value) / count) for epoch, value in enumerate(sums, start=1))


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
