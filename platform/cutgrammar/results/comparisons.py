"""How methods compare with the reference method on the trials they share: differences, tests, wins and profiles.

All of it is about the deciding score. The unit is the trial (see `statistics`).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cutgrammar.results.statistics import (
    bootstrap_band,
    bootstrap_interval,
    holm,
    paired_test,
    share_of_wins,
    shares_above,
)
from cutgrammar.seeds import stream

ALL = "all"
"""Names all setups together."""

AGAINST = "grammar"
"""The method that the others are tested against."""

THRESHOLDS = tuple(i / 40 for i in range(41))
"""Scores at which a performance profile is given."""

Condition = tuple[str, str, str]
"""Goals, world, perception."""

Unit = tuple[str, str, int]
"""Setup, data digest, trial."""

Scores = Mapping[Unit, Sequence[float]]
"""Deciding score of every trial in each of its runs."""

Cell = tuple[str, str]
"""Setup (or `ALL`) and method."""


def tests_against(condition: Condition, cells: Mapping[Cell, Scores]) -> list[dict[str, Any]]:
    """Every other method minus `AGAINST`, cell by cell, with paired tests corrected for their number.

    The tests over all setups are one family, those of single setups another.
    """
    tests: list[dict[str, Any]] = []
    for (setup, method), shared in _shared_trials(cells).items():
        names = (setup, method, *condition)
        differences = {unit: float(np.mean(runs) - np.mean(reference)) for unit, (runs, reference) in shared.items()}
        tests.append(
            {
                "setup": setup,
                **condition_fields(condition),
                "method": method,
                "against": AGAINST,
                "trials": len(shared),
                **paired_difference(
                    differences, stream(0, "report", "difference", *names), stream(0, "report", "test", *names)
                ),
                "p_corrected": None,
            }
        )
    for family in ([t for t in tests if t["setup"] == ALL], [t for t in tests if t["setup"] != ALL]):
        for test, corrected in zip(family, holm([test["p_value"] for test in family]), strict=True):
            test["p_corrected"] = corrected
    return tests


def improvements(condition: Condition, cells: Mapping[Cell, Scores]) -> list[dict[str, Any]]:
    """Probability that a run of `AGAINST` scores above a run of each other method, averaged over trials.

    A tie counts half. The interval is a bootstrap over trials within their setup.
    """
    entries = []
    for (setup, method), shared in _shared_trials(cells).items():
        wins = [share_of_wins(reference, runs) for runs, reference in shared.values()]
        rng = stream(0, "report", "improvement", setup, method, *condition)
        entries.append(
            {
                "setup": setup,
                **condition_fields(condition),
                "method": AGAINST,
                "over": method,
                "trials": len(shared),
                "probability": float(np.mean(wins)) if wins else None,
                "ci95": interval_of_mean(wins, shared, rng),
            }
        )
    return entries


def profiles(condition: Condition, cells: Mapping[Cell, Scores]) -> list[dict[str, Any]]:
    """The share of runs above each of `THRESHOLDS` for every method over all setups; every trial counts once.

    The band is a bootstrap over trials within their setup, separate at each threshold; None where a setup has a single
    trial.
    """
    entries = []
    for method, scores in ((method, scores) for (setup, method), scores in cells.items() if setup == ALL):
        units = sorted(scores)
        numbers = [i for i, unit in enumerate(units) for _ in scores[unit]]
        _, shares = shares_above([score for unit in units for score in scores[unit]], numbers, THRESHOLDS)
        rng = stream(0, "report", "profile", method, *condition)
        band = bootstrap_band(shares, to_numbers(unit[0] for unit in units), rng)
        entries.append(
            {
                "setup": ALL,
                **condition_fields(condition),
                "method": method,
                "thresholds": list(THRESHOLDS),
                "share": shares.mean(axis=0).tolist(),
                "ci95": None if band is None else [end.tolist() for end in band],
            }
        )
    return entries


def paired_difference(
    differences: Mapping[Unit, float], interval_rng: np.random.Generator, test_rng: np.random.Generator
) -> dict[str, Any]:
    """The mean of paired differences, one a trial, with its interval and p-value; all None without trials."""
    values = np.array(list(differences.values()))
    return {
        "mean_difference": float(values.mean()) if differences else None,
        "ci95": interval_of_mean(values, differences, interval_rng),
        "p_value": paired_test(values, test_rng),
    }


def interval_of_mean(
    values: ArrayLike, units: Iterable[Unit], rng: np.random.Generator, balanced: bool = False
) -> list[float] | None:
    """Ends of the bootstrap interval of the mean over trials, resampled within their setup.

    Args:
        values: (n,) one value a trial.
        units: the n trials.
        rng: stream that draws the resamples.
        balanced: every setup counts once, instead of every trial.

    Returns:
        Low and high end; None without trials, or where a setup has a single one.
    """
    setups = to_numbers(unit[0] for unit in units)
    interval = bootstrap_interval(values, setups, rng, balanced=balanced) if setups else None
    return None if interval is None else list(interval)


def to_numbers(names: Iterable[Any]) -> list[int]:
    """Each name as its rank among the different names."""
    named = list(names)
    number = {name: i for i, name in enumerate(sorted(set(named)))}
    return [number[name] for name in named]


def condition_fields(condition: Condition) -> dict[str, str]:
    """A condition as fields of an entry."""
    return dict(zip(("goals", "world", "perception"), condition, strict=True))


def _shared_trials(cells: Mapping[Cell, Scores]) -> dict[Cell, dict[Unit, tuple[Sequence[float], Sequence[float]]]]:
    """For each cell of another method than `AGAINST`, the runs of both on every trial that both have."""
    return {
        (setup, method): {unit: (scores[unit], reference[unit]) for unit in sorted(set(scores) & set(reference))}
        for (setup, method), scores in cells.items()
        if method != AGAINST and (reference := cells.get((setup, AGAINST))) is not None
    }
