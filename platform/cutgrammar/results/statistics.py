"""Statistics of a table of results: spread over runs, intervals, paired tests, wins and profiles.

The unit is the trial, its score averaged over its runs: runs of one trial share the goal, so counting them separately
would claim more evidence than there is. Functions take plain arrays and, where they draw, a random stream.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from cutgrammar.geometry.arrays import Floats

N_RESAMPLES = 10_000
"""Draws of a bootstrap, or of a permutation test that is not enumerated."""
MAX_ENUMERATED = 14
"""Up to this many differences the permutation test goes through all patterns of signs."""
MAX_RESAMPLED = 200
"""Up to this many trials of one model intervals and tests resample; beyond, they are those of Student's t."""
MAX_CELLS = 2_000_000
"""Random numbers in memory at once."""


def mean_of(values: Sequence[float]) -> float:
    """The mean of a few values; for so few, NumPy takes ten times as long."""
    return sum(values) / len(values)


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
    n_resamples: int = N_RESAMPLES,
    balanced: bool = False,
) -> tuple[float, float] | None:
    """Percentile bootstrap interval of the mean, resampling units within their stratum (`scipy.stats.bootstrap`).

    Args:
        values: (n,) one score a unit.
        strata: (n,) whole number of the stratum (setup) of each unit; every resample keeps their sizes.
        rng: stream that draws the resamples.
        level: probability mass inside the interval.
        n_resamples: number of resamples.
        balanced: of the mean over strata of their means, in which every stratum counts once, instead of every unit.

    Returns:
        Low and high end, or None where a stratum has a single unit: how much it varies is then not known.

    Raises:
        ValueError: no units, or another number of strata.
    """
    v, names = _paired_columns(values, strata)
    band = bootstrap_band(v[:, None], names, rng, level, n_resamples, balanced)
    return None if band is None else (float(band[0][0]), float(band[1][0]))


def bootstrap_band(
    rows: ArrayLike,
    strata: ArrayLike,
    rng: np.random.Generator,
    level: float = 0.95,
    n_resamples: int = N_RESAMPLES,
    balanced: bool = False,
) -> tuple[Floats, Floats] | None:
    """`bootstrap_interval` of every column's mean. The columns share their resamples.

    Args:
        rows: (u, t) one row a unit; the band of a falling profile falls too.
        strata, rng, level, n_resamples, balanced: as in `bootstrap_interval`; `level` holds at each column.

    Returns:
        (t,) low and (t,) high ends, or None where a stratum has a single unit.

    Raises:
        ValueError: no units, or another number of strata.
    """
    x, names = np.asarray(rows, dtype=np.float64), np.asarray(strata, dtype=np.int64)
    if x.ndim != 2 or not len(x) or names.shape != x.shape[:1]:
        raise ValueError(f"{x.shape} rows with {names.shape} strata: one row and one stratum a unit were expected")
    groups = [x[names == name].T for name in np.unique(names)]
    sizes = [group.shape[1] for group in groups]
    if min(sizes) < 2:
        return None
    weights = [len(x) / len(groups) / size if balanced else 1.0 for size in sizes]

    def mean(*samples: Floats, axis: int) -> Floats:
        sums = (w * sample.sum(axis=axis) for w, sample in zip(weights, samples, strict=True))
        return np.asarray(sum(sums) / len(x))

    found = stats.bootstrap(
        groups,
        mean,
        axis=1,
        n_resamples=n_resamples,
        batch=max(1, MAX_CELLS // x.size),
        confidence_level=level,
        method="percentile",
        vectorized=True,
        rng=rng,
    )
    return found.confidence_interval.low, found.confidence_interval.high


def paired_test(differences: ArrayLike, rng: np.random.Generator, n_resamples: int = N_RESAMPLES) -> float | None:
    """Two-sided p-value of the paired permutation test: could the mean difference come from random signs?

    `scipy.stats.permutation_test` goes through all patterns of signs for few differences. For many,
    `scipy.stats.monte_carlo_test` draws them and counts the observed pattern as one of them, so the p-value is never 0.
    Beyond `MAX_RESAMPLED` it is that of the paired t test (`scipy.stats.ttest_1samp`).

    Args:
        differences: (n,) score of one method minus that of another, one a unit.
        rng: stream that draws the signs where they are too many to enumerate.
        n_resamples: patterns drawn in that case.

    Returns:
        The p-value; None with fewer than two differences, where no test can say anything.

    Raises:
        ValueError: not a row of finite numbers.
    """
    d = _finite_row(differences)
    n = len(d)
    if n < 2:
        return None
    if n > MAX_RESAMPLED:
        is_constant = bool((d == d[0]).all())  # SciPy then divides by 0
        return float(d[0] == 0.0) if is_constant else float(stats.ttest_1samp(d, 0.0).pvalue)

    def statistic(x: Floats, axis: int) -> Floats:
        return np.asarray(np.abs(x.mean(axis=axis)))

    def draw(size: tuple[int, ...]) -> Floats:
        return np.where(rng.integers(0, 2, size, dtype=np.bool_), d, -d)

    options = {"vectorized": True, "batch": max(1, MAX_CELLS // n), "alternative": "greater"}
    if n <= MAX_ENUMERATED:
        found = stats.permutation_test((d,), statistic, permutation_type="samples", n_resamples=np.inf, **options)
    else:
        found = stats.monte_carlo_test(d, draw, statistic, n_resamples=n_resamples, **options)
    return float(found.pvalue)


def share_of_wins(scores: Sequence[float], others: Sequence[float]) -> float:
    """Probability that a run scores above a run of another method on one unit; a tie counts half (Mann-Whitney U).

    Averaged over units it is the probability of improvement (Agarwal et al. 2021), with the trial as the task.

    Args:
        scores: (r,) of the runs of one method on the unit.
        others: (q,) of the runs of the other method.

    Raises:
        ValueError: one of them is empty, or not finite.
    """
    if not len(scores) or not len(others):
        raise ValueError(f"{len(scores)} runs against {len(others)}: both methods need at least one")
    if not all(map(math.isfinite, (*scores, *others))):
        raise ValueError("scores of runs must be finite")
    ordered = sorted(others)
    twice = sum(bisect_left(ordered, score) + bisect_right(ordered, score) for score in scores)  # so a tie counts half
    return twice / 2 / (len(scores) * len(others))


def shares_above(scores: ArrayLike, thresholds: ArrayLike) -> Floats:
    """Share of the runs of one unit that score above each threshold; its mean over units is the performance profile.

    Args:
        scores: (r,) of the runs.
        thresholds: (t,).

    Returns:
        (t,) shares.

    Raises:
        ValueError: no runs, or a score that is not finite.
    """
    row = _finite_row(scores)
    if not len(row):
        raise ValueError("no runs: a unit needs at least one")
    return np.asarray((row[:, None] > np.asarray(thresholds)).mean(axis=0))


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Holm's correction for testing several hypotheses at once; unknown p-values (None) are left out of it."""
    known = sorted((p, i) for i, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    largest = 0.0
    for rank, (p, i) in enumerate(known):
        largest = max(largest, min(1.0, p * (len(known) - rank)))
        corrected[i] = largest
    return corrected


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
