"""What a table of results says of its numbers: spread over runs, intervals, paired tests, wins and profiles.

The unit is the trial, its score averaged over its runs: runs of one trial share the goal, so counting them apart would
claim more evidence than there is. Everything takes plain arrays and, where it draws, a random stream.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutgrammar.geometry.arrays import Floats

RESAMPLES = 10_000
"""Draws of a bootstrap or of a permutation test that is not enumerated."""

LARGEST_ENUMERATED = 14
"""Up to this many differences the permutation test goes through all patterns of signs."""

CELLS = 2_000_000
"""Random numbers held in memory at once."""


def per_unit(values: ArrayLike, units: ArrayLike) -> tuple[NDArray[np.int64], Floats]:
    """Average over the rows of each unit.

    Args:
        values: (n,) scores.
        units: (n,) whole number of the unit that each row belongs to.

    Returns:
        (u,) the units, ascending, and (u,) their means.

    Raises:
        ValueError: no rows, or another number of units.
    """
    v, names = _paired_columns(values, units)
    unique, where, counts = np.unique(names, return_inverse=True, return_counts=True)
    return unique, np.bincount(where, weights=v) / counts


def std_over_runs(values: ArrayLike, runs: ArrayLike) -> float | None:
    """Standard deviation (n - 1) of the means of the runs, the +- of Table I; None with fewer than two runs.

    Args:
        values: (n,) scores.
        runs: (n,) whole number of the run that each row belongs to.
    """
    _, means = per_unit(values, runs)
    return float(means.std(ddof=1)) if len(means) > 1 else None


def bootstrap_interval(
    values: ArrayLike,
    strata: ArrayLike,
    rng: np.random.Generator,
    level: float = 0.95,
    resamples: int = RESAMPLES,
    balanced: bool = False,
) -> tuple[float, float] | None:
    """Percentile bootstrap interval of the mean, resampling units within their stratum.

    Args:
        values: (n,) one score a unit.
        strata: (n,) whole number of the stratum (setup) of each unit; every resample keeps their sizes.
        rng: stream that draws the resamples.
        level: probability mass inside the interval.
        resamples: number of resamples.
        balanced: of the mean over strata of their means, in which every stratum counts once, instead of every unit.

    Returns:
        Low and high end, or None where a stratum has a single unit: how much it varies is then not known.

    Raises:
        ValueError: no units, or another number of strata.
    """
    v, names = _paired_columns(values, strata)
    groups = [v[names == name] for name in np.unique(names)]
    if min(len(group) for group in groups) < 2:
        return None
    totals = np.zeros(resamples)
    for group in groups:
        totals += _resampled_sums(group, rng, resamples) * (len(v) / len(group) / len(groups) if balanced else 1.0)
    means = totals / len(v)
    tail = (1.0 - level) / 2.0
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return float(low), float(high)


def paired_test(differences: ArrayLike, rng: np.random.Generator, resamples: int = RESAMPLES) -> float | None:
    """Two-sided p-value of the paired permutation test: could the mean difference come from random signs?

    All patterns of signs are gone through for few differences; for many they are drawn, and the p-value then counts
    the observed pattern as one of them, so it is never 0.

    Args:
        differences: (n,) score of one method minus that of another, one a unit.
        rng: stream that draws the signs where they are too many to enumerate.
        resamples: patterns drawn in that case.

    Returns:
        The p-value; None with fewer than two differences, where no test can say anything.

    Raises:
        ValueError: not a row of finite numbers.
    """
    d = _finite_row(differences)
    n = len(d)
    if n < 2:
        return None
    reached = abs(d.sum()) - 1e-12 * np.abs(d).sum()  # sums in another order differ by rounding
    if n <= LARGEST_ENUMERATED:
        patterns = 1.0 - 2.0 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
        return float(np.mean(np.abs(patterns @ d) >= reached))
    sums = _in_blocks(lambda m: (1.0 - 2.0 * rng.integers(2, size=(m, n))) @ d, resamples, n)
    return float((1 + np.count_nonzero(np.abs(sums) >= reached)) / (1 + resamples))


def share_of_wins(ours: ArrayLike, theirs: ArrayLike) -> float:
    """How probably a run of ours scores above one of theirs on this unit; a tie counts half (Mann and Whitney's U).

    Averaged over units it is the probability of improvement (Agarwal et al. 2021), with the trial as the task.

    Args:
        ours: (r,) scores of the runs of one method on one unit.
        theirs: (q,) those of another method on the same unit.

    Raises:
        ValueError: one of them is empty, or not a row of finite numbers.
    """
    a, b = _finite_row(ours), _finite_row(theirs)
    if not len(a) or not len(b):
        raise ValueError(f"{len(a)} runs against {len(b)}: none wins where there is none")
    return float(np.mean((a[:, None] > b) + 0.5 * (a[:, None] == b)))


def shares_above(values: ArrayLike, units: ArrayLike, thresholds: ArrayLike) -> tuple[NDArray[np.int64], Floats]:
    """Of each unit the share of its rows that score above each threshold; their mean is the performance profile.

    Args:
        values: (n,) scores.
        units: (n,) whole number of the unit that each row belongs to.
        thresholds: (t,).

    Returns:
        (u,) the units, ascending, and (u, t) their shares.
    """
    v, names = _paired_columns(values, units)
    unique, where, counts = np.unique(names, return_inverse=True, return_counts=True)
    shares = np.zeros((len(unique), np.size(thresholds)))
    np.add.at(shares, where, (v[:, None] > np.asarray(thresholds, dtype=np.float64)).astype(np.float64))
    return unique, shares / counts[:, None]


def bootstrap_band(
    shares: ArrayLike, strata: ArrayLike, rng: np.random.Generator, level: float = 0.95, resamples: int = RESAMPLES
) -> tuple[Floats, Floats] | None:
    """Percentile bootstrap interval of every column's mean, resampling units within their stratum.

    The columns share their resamples, so that the ends of a falling profile's band fall too.

    Args:
        shares: (u, t) one row a unit.
        strata: (u,) whole number of the stratum (setup) of each unit; every resample keeps their sizes.
        rng: stream that draws the resamples.
        level: probability mass inside the interval, at each column by itself.
        resamples: number of resamples.

    Returns:
        (t,) low and (t,) high ends, or None where a stratum has a single unit.

    Raises:
        ValueError: no units, or another number of strata.
    """
    rows, names = np.asarray(shares, dtype=np.float64), np.asarray(strata, dtype=np.int64)
    if rows.ndim != 2 or not len(rows) or names.shape != rows.shape[:1]:
        raise ValueError(f"{rows.shape} shares with {names.shape} strata: one row and one stratum a unit were expected")
    groups = [rows[names == name] for name in np.unique(names)]
    if min(len(group) for group in groups) < 2:
        return None
    means = np.zeros((resamples, rows.shape[1]))
    for group in groups:
        drawn = rng.multinomial(len(group), np.full(len(group), 1.0 / len(group)), size=resamples)
        # einsum adds in the same order wherever it runs; a product of matrices does not.
        means += np.einsum("ru,ut->rt", drawn.astype(np.float64), group)
    tail = (1.0 - level) / 2.0
    low, high = np.quantile(means / len(rows), [tail, 1.0 - tail], axis=0)
    return low, high


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Holm's correction for testing several hypotheses at once; None stays None and counts for nothing."""
    known = sorted((p, i) for i, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    least = 0.0
    for rank, (p, i) in enumerate(known):
        least = max(least, min(1.0, p * (len(known) - rank)))
        corrected[i] = least
    return corrected


def _resampled_sums(group: Floats, rng: np.random.Generator, resamples: int) -> Floats:
    n = len(group)
    return _in_blocks(lambda m: group[rng.integers(n, size=(m, n))].sum(axis=1), resamples, n)


def _in_blocks(draw: Callable[[int], Floats], count: int, width: int) -> Floats:
    """`count` numbers from `draw(m)`, asked for in blocks so that no block holds more than `CELLS` cells."""
    block = max(1, CELLS // max(1, width))
    return np.concatenate([draw(min(block, count - done)) for done in range(0, count, block)])


def _finite_row(values: ArrayLike) -> Floats:
    row = np.asarray(values, dtype=np.float64)
    if row.ndim != 1 or not np.isfinite(row).all():
        raise ValueError(f"an array of shape {row.shape} is not a row of finite numbers")
    return row


def _paired_columns(values: ArrayLike, names: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    v, k = np.asarray(values, dtype=np.float64), np.asarray(names, dtype=np.int64)
    if v.ndim != 1 or v.shape != k.shape or not len(v):
        raise ValueError(f"{v.shape} values with {k.shape} names: two rows of one length, not empty, were expected")
    if not np.isfinite(v).all():
        raise ValueError("a score that is not known must be left out, not given as NaN")
    return v, k
