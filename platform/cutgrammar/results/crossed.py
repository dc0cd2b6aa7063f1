"""Means over trials and trained models that are crossed: every model has every trial, and both are a sample.

A score x_ij of trial i with model j has a part of the trial, a part of the model, and a rest. The squared standard
error of the mean is taken as the sum of two terms: that of the trials' means, resampled within their setup, and that of
the models' means. The rest is in both, so the sum is a little too large, never too small. The degrees of freedom follow
Satterthwaite (1946): near m - 1 where models differ most, near the number of trials where they do not differ. With five
models a test on this statistic keeps its level; a percentile bootstrap over models does not, because five values
resampled vary too little, and a test over trials alone does not, because it takes one training for all (see
`benchmarks/type_one_error.py`).

Data sets are strata: models are trained on one and tested on its trials, so models are nested in data sets.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from cutgrammar.geometry.arrays import Floats


@dataclass(frozen=True, eq=False)
class Crossing:
    """The scores of one data set.

    Attributes:
        values: (n, m, ...) score of each of n trials with each of m models; further axes are separate statistics.
        setups: (n,) whole number of the setup of each trial.
    """

    values: Floats
    setups: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CrossedMean:
    """A mean and how certain it is.

    Attributes:
        mean: (...) over trials and models.
        standard_error: (...) of the mean.
        degrees: (...) of freedom of Student's t; infinite where the standard error is 0.
    """

    mean: Floats
    standard_error: Floats
    degrees: Floats

    def interval(self, level: float = 0.95) -> tuple[Floats, Floats]:
        """(...) low and (...) high ends of the interval that holds `level` of the probability."""
        half = stats.t.ppf(0.5 + level / 2, self.degrees) * self.standard_error
        return self.mean - half, self.mean + half

    def p_value(self) -> float:
        """Two-sided p-value of a single mean: could it come from a population whose mean is 0?"""
        if self.standard_error == 0.0:
            return 1.0 if self.mean == 0.0 else 0.0
        return float(2.0 * stats.t.sf(abs(self.mean) / self.standard_error, self.degrees))


def crossed_mean(
    crossings: Sequence[Crossing], balanced: bool = False, for_these_models: bool = False
) -> CrossedMean | None:
    """The mean over all trials and models of one or more data sets.

    Args:
        crossings: of each data set, at least one.
        balanced: every setup counts once, instead of every trial.
        for_these_models: only trials are a sample, and what is said holds for these models; a single one suffices.

    Returns:
        None where a data set has a single model, or a setup in it a single trial: how much these vary is then not
        known.

    Raises:
        ValueError: no data set, or one whose arrays do not fit.
    """
    if not crossings or any(c.values.ndim < 2 or c.setups.shape != c.values.shape[:1] for c in crossings):
        raise ValueError("scores of at least one data set were expected, (n, m, ...) with (n,) setups")
    sizes = np.unique_counts(np.concatenate([c.setups for c in crossings]))
    weight_of = {
        int(setup): 1.0 / (len(sizes.values) * count if balanced else sizes.counts.sum())
        for setup, count in zip(sizes.values, sizes.counts, strict=True)
    }
    mean, variances, degrees = np.zeros(()), [], []
    for crossing in crossings:
        x, n_models = crossing.values, crossing.values.shape[1]
        weights = np.array([weight_of[int(setup)] for setup in crossing.setups])
        of_models = np.tensordot(weights, x, axes=1)
        mean = mean + of_models.mean(axis=0)
        if not for_these_models:
            if n_models < 2:
                return None
            variances.append(of_models.var(axis=0, ddof=1) / n_models)
            degrees.append(n_models - 1)
        for setup in np.unique(crossing.setups):
            of_trials = x[crossing.setups == setup].mean(axis=1)
            n_trials = len(of_trials)
            if n_trials < 2:
                return None
            variances.append(weight_of[int(setup)] ** 2 * n_trials * of_trials.var(axis=0, ddof=1))
            degrees.append(n_trials - 1)
    parts, of_parts = np.array(variances), np.array(degrees)
    variance = parts.sum(axis=0)
    spread = np.tensordot(1.0 / of_parts, parts**2, axes=1)
    return CrossedMean(
        mean, np.sqrt(variance), np.divide(variance**2, spread, out=np.full_like(variance, np.inf), where=spread > 0.0)
    )
