"""How methods compare with reference methods on the trials they share: differences, tests, wins and profiles.

All of it is about the deciding score. The unit is the trial (see `samples`).
"""

from collections.abc import Mapping, Sequence
from typing import Any

from cutgrammar.results.samples import (
    Scores,
    Unit,
    band_of_means,
    by_unit,
    interval_of_mean,
    n_models,
    paired,
    paired_difference,
)
from cutgrammar.results.statistics import holm, mean_of, share_of_wins, shares_above
from cutgrammar.seeds import stream

ALL = "all"
"""Names all setups together."""

AGAINST = "grammar"
"""The paper's method, the first of the reference methods."""

REFERENCES = (AGAINST, "grammar-plus", "guided")
"""The methods that the others are tested against, of those that were evaluated."""

THRESHOLDS = tuple(i / 40 for i in range(41))
"""Scores at which a performance profile is given."""

Condition = tuple[str, str, str]
"""Goals, world, perception."""

Cell = tuple[str, str]
"""Setup (or `ALL`) and method."""

Shared = Mapping[Unit, Mapping[str, tuple[Sequence[float], Sequence[float]]]]
"""Trial -> model -> the runs of a method and those of a reference method."""


def tests_against(against: str, condition: Condition, shared_trials: Mapping[Cell, Shared]) -> list[dict[str, Any]]:
    """Every other method minus the reference method `against`, cell by cell, with tests corrected for their number.

    The tests over all setups are one family, those of single setups another.

    Args:
        against: the reference method.
        condition: of all runs.
        shared_trials: see `shared_with`.
    """
    tests: list[dict[str, Any]] = []
    for (setup, method), shared in shared_trials.items():
        names = (setup, method, *_of_reference(against), *condition)
        differences = {
            unit: {model: mean_of(runs) - mean_of(reference) for model, (runs, reference) in pairs.items()}
            for unit, pairs in shared.items()
        }
        tests.append(
            {
                "setup": setup,
                **condition_fields(condition),
                "method": method,
                "against": against,
                "trials": len(shared),
                "models": n_models(differences),
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


def improvements(against: str, condition: Condition, shared_trials: Mapping[Cell, Shared]) -> list[dict[str, Any]]:
    """Probability that a run of `against` scores above a run of each other method; a tie counts half.

    Runs are compared on the same trial and with the same model. Arguments are those of `tests_against`.
    """
    entries = []
    for (setup, method), shared in shared_trials.items():
        wins = {
            unit: {model: share_of_wins(reference, runs) for model, (runs, reference) in pairs.items()}
            for unit, pairs in shared.items()
        }
        rng = stream(0, "report", "improvement", setup, method, *_of_reference(against), *condition)
        entries.append(
            {
                "setup": setup,
                **condition_fields(condition),
                "method": against,
                "over": method,
                "trials": len(shared),
                "probability": float(by_unit(wins).mean()) if wins else None,
                "ci95": interval_of_mean(wins, rng),
            }
        )
    return entries


def profiles(condition: Condition, cells: Mapping[Cell, Scores]) -> list[dict[str, Any]]:
    """The share of runs above each of `THRESHOLDS` for every method over all setups; every trial counts once.

    The band is the 95 % interval at each threshold; None where a setup has a single trial.
    """
    entries = []
    for method, scores in ((method, scores) for (setup, method), scores in cells.items() if setup == ALL):
        shares = {
            unit: {model: shares_above(runs, THRESHOLDS) for model, runs in models.items()}
            for unit, models in scores.items()
        }
        rng = stream(0, "report", "profile", method, *condition)
        entries.append(
            {
                "setup": ALL,
                **condition_fields(condition),
                "method": method,
                "thresholds": list(THRESHOLDS),
                "share": by_unit(shares).mean(axis=0).tolist(),
                "ci95": band_of_means(shares, rng),
            }
        )
    return entries


def condition_fields(condition: Condition) -> dict[str, str]:
    """A condition as fields of an entry."""
    return dict(zip(("goals", "world", "perception"), condition, strict=True))


def _of_reference(against: str) -> tuple[str, ...]:
    """The part of a random stream's name that tells the reference method; none for the first, as it was alone once."""
    return () if against == AGAINST else (against,)


def shared_with(against: str, cells: Mapping[Cell, Scores]) -> dict[Cell, Shared]:
    """For each cell of another method than `against`, the runs of both on every trial that both have, by model."""
    return {
        (setup, method): paired(scores, reference)
        for (setup, method), scores in cells.items()
        if method != against and (reference := cells.get((setup, against))) is not None
    }
