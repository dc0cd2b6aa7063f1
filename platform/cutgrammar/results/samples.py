"""A value of every trial with every model that carried it out, and how certain its mean is.

The unit is the trial: its runs share the goal. With several models in each data set, trials and models are both taken
as random (see `crossed`). With one model there is nothing to tell how much training varies: intervals and tests are
then about trials alone, and hold for that model only. They resample up to `MAX_RESAMPLED` trials, and take Student's t
beyond, whose intervals are then a few percent wider, in a fiftieth of the time (see `benchmarks/many_trials.py`).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cutgrammar.geometry.arrays import Floats
from cutgrammar.results.crossed import CrossedMean, Crossing, crossed_mean
from cutgrammar.results.statistics import MAX_RESAMPLED, bootstrap_band, bootstrap_interval, mean_of, paired_test

Unit = tuple[str, str, int]
"""Setup, data digest, trial."""

ANY_MODEL = "*"
"""Stands for the model of trials that no model changes; they are carried out once and hold for every model."""

Sample = Mapping[Unit, Mapping[str, ArrayLike]]
"""Trial -> model -> value, or (t,) values."""

Scores = Mapping[Unit, Mapping[str, Sequence[float]]]
"""Trial -> model -> deciding score of each of its runs."""


def paired(ours: Scores, others: Scores) -> dict[Unit, dict[str, tuple[Sequence[float], Sequence[float]]]]:
    """The runs of two methods on every trial and with every model that both have; trials that share no model are left
    out."""
    found = {}
    for unit in sorted(set(ours) & set(others)):
        mine, theirs = ours[unit], others[unit]
        models = [model for model in dict.fromkeys((*mine, *theirs)) if model != ANY_MODEL] or [ANY_MODEL]
        pairs = {model: (_runs_with(mine, model), _runs_with(theirs, model)) for model in sorted(models)}
        found[unit] = {model: (a, b) for model, (a, b) in pairs.items() if a and b}
    return {unit: pairs for unit, pairs in found.items() if pairs}


def means_of(scores: Scores) -> dict[Unit, dict[str, float]]:
    """Every trial and model averaged over its runs."""
    return {unit: {model: mean_of(runs) for model, runs in models.items()} for unit, models in scores.items()}


def by_unit(sample: Sample) -> Floats:
    """(n,) or (n, t) values of the trials, each averaged over its models, in the order of trials."""
    of_models = (list(sample[unit].values()) for unit in sorted(sample))
    return np.array([values[0] if len(values) == 1 else np.mean(np.asarray(values), axis=0) for values in of_models])


def n_models(sample: Mapping[Unit, Mapping[str, Any]]) -> int:
    """Number of models, of all data sets together."""
    return len({(unit[1], model) for unit, models in sample.items() for model in models if model != ANY_MODEL})


def interval_of_mean(sample: Sample, rng: np.random.Generator, balanced: bool = False) -> list[float] | None:
    """Ends of the 95 % interval of the mean.

    Args:
        sample: one value for each trial and model.
        rng: stream that draws resamples, where there is one model.
        balanced: every setup counts once, instead of every trial.

    Returns:
        Low and high end; None without trials, or where a setup has a single one.
    """
    if not sample:
        return None
    if _is_by_t(sample):
        crossed = _mean_by_t(sample, balanced)
        return None if crossed is None else [float(end) for end in crossed.interval()]
    interval = bootstrap_interval(by_unit(sample), _setups(sample), rng, balanced=balanced)
    return None if interval is None else list(interval)


def band_of_means(sample: Sample, rng: np.random.Generator) -> list[list[float]] | None:
    """Ends of the 95 % interval at each of the (t,) values of trials and models; None where a setup has one trial."""
    if _is_by_t(sample):
        crossed = _mean_by_t(sample)
        return None if crossed is None else [np.clip(end, 0.0, 1.0).tolist() for end in crossed.interval()]
    band = bootstrap_band(by_unit(sample), _setups(sample), rng)
    return None if band is None else [end.tolist() for end in band]


def paired_difference(
    differences: Sample, interval_rng: np.random.Generator, test_rng: np.random.Generator
) -> dict[str, Any]:
    """The mean of paired differences with its 95 % interval and p-value; all None without trials.

    The p-value is that of Student's t where each data set has several models, and None where a setup then has a single
    trial. Where there is one model it is that of `paired_test` over trials.
    """
    if not differences:
        return {"mean_difference": None, "ci95": None, "p_value": None}
    if _has_several_models(differences):
        crossed = _crossed(differences)
        p_value = None if crossed is None else crossed.p_value()
    else:
        p_value = paired_test(by_unit(differences), test_rng)
    mean, interval = float(by_unit(differences).mean()), interval_of_mean(differences, interval_rng)
    return {"mean_difference": mean, "ci95": interval, "p_value": p_value}


def to_numbers(names: Iterable[Any]) -> list[int]:
    """Each name as its rank among the different names."""
    named = list(names)
    number = {name: i for i, name in enumerate(sorted(set(named)))}
    return [number[name] for name in named]


def _runs_with(runs: Mapping[str, Sequence[float]], model: str) -> Sequence[float]:
    """The runs with a model, or those that hold for every model."""
    return runs.get(model, runs.get(ANY_MODEL, ()))


def _setups(sample: Sample) -> list[int]:
    return to_numbers(unit[0] for unit in sorted(sample))


def _models_of(sample: Sample) -> dict[str, set[str]]:
    """Data set -> its models."""
    models: dict[str, set[str]] = {}
    for (_, data, _), of_unit in sample.items():
        models.setdefault(data, set()).update(of_unit)
    return models


def _has_several_models(sample: Sample) -> bool:
    """Whether every data set has several models."""
    return all(len(models) > 1 for models in _models_of(sample).values())


def _is_by_t(sample: Sample) -> bool:
    return len(sample) > MAX_RESAMPLED or _has_several_models(sample)


def _mean_by_t(sample: Sample, balanced: bool = False) -> CrossedMean | None:
    """The mean over trials and models, or over trials alone where models are no sample; None as in `_crossed`."""
    if _has_several_models(sample):
        return _crossed(sample, balanced)
    trials = Crossing(by_unit(sample)[:, None], np.array(_setups(sample)))
    return crossed_mean([trials], balanced, for_these_models=True)


def _crossed(sample: Sample, balanced: bool = False) -> CrossedMean | None:
    """The mean over trials and models; None where a setup of a data set has a single trial.

    Trials that lack a model of their data set, as in an evaluation that is not finished, are left out.
    """
    models = _models_of(sample)
    units = [unit for unit in sorted(sample) if len(sample[unit]) == len(models[unit[1]])]
    if {unit[1] for unit in units} != set(models):
        return None
    setups = dict(zip(units, to_numbers(unit[0] for unit in units), strict=True))
    crossings = []
    for data in sorted(models):
        of_data = [unit for unit in units if unit[1] == data]
        values = np.array([[sample[unit][model] for model in sorted(models[data])] for unit in of_data])
        crossings.append(Crossing(values, np.array([setups[unit] for unit in of_data])))
    return crossed_mean(crossings, balanced)
