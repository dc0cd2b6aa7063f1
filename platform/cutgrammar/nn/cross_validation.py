"""Held-out folds by group, so that what one demonstration repeats cannot be seen and be asked at once."""

import numpy as np

from cutgrammar.geometry.arrays import Ints


def folds_of(groups: Ints, folds: int, rng: np.random.Generator) -> list[tuple[Ints, Ints]]:
    """Row numbers (to fit on, held out) of every fold; none where there are fewer than two of them or of groups.

    Args:
        groups: (n,) group of each row, e.g. the number of its trial; a group is never divided.
        folds: how many folds to make; at most one for each group.
        rng: deals the groups out.
    """
    names = rng.permutation(np.unique(groups))
    count = min(folds, len(names))
    if count < 2:
        return []
    held = [np.isin(groups, part) for part in np.array_split(names, count)]
    return [(np.flatnonzero(~rows), np.flatnonzero(rows)) for rows in held]


def best_epoch(losses: tuple[float, ...]) -> int:
    """The number, from 1, of the first epoch with the least loss."""
    return int(np.argmin(losses)) + 1
