"""How methods compare with the reference method on the trials they share: differences, tests, wins and profiles.

All of it is about the deciding score. The unit is the trial (see `statistics`).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

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
    found = [_difference(condition, cell, cells[cell], reference) for cell, reference in _with_reference(cells)]
    for family in ([t for t in found if t["setup"] == ALL], [t for t in found if t["setup"] != ALL]):
        for test, corrected in zip(family, holm([test["p_value"] for test in family]), strict=True):
            test["p_corrected"] = corrected
    return found


def improvements(condition: Condition, cells: Mapping[Cell, Scores]) -> list[dict[str, Any]]:
    """Probability that a run of `AGAINST` scores above a run of each other method, averaged over trials.

    A tie counts half. The interval is a bootstrap over trials within their setup.
    """
    return [_improvement(condition, cell, reference, cells[cell]) for cell, reference in _with_reference(cells)]


def profiles(condition: Condition, cells: Mapping[Cell, Scores]) -> list[dict[str, Any]]:
    """The share of runs above each of `THRESHOLDS` for every method over all setups; every trial counts once.

    The band is a bootstrap over trials within their setup, separate at each threshold; None where a setup has a single
    trial.
    """
    return [_profile(condition, method, scores) for (setup, method), scores in cells.items() if setup == ALL and scores]


def to_numbers(names: Iterable[Any]) -> list[int]:
    """Each name as its rank among the different names."""
    named = list(names)
    number = {name: i for i, name in enumerate(sorted(set(named)))}
    return [number[name] for name in named]


def condition_fields(condition: Condition) -> dict[str, str]:
    """A condition as fields of an entry."""
    return dict(zip(("goals", "world", "perception"), condition, strict=True))


def condition_of(entry: Mapping[str, Any]) -> Condition:
    """The condition of an entry."""
    return entry["goals"], entry["world"], entry["perception"]


def _with_reference(cells: Mapping[Cell, Scores]) -> list[tuple[Cell, Scores]]:
    """The cells of the other methods, each with the scores of `AGAINST` in its setup."""
    return [
        ((setup, method), cells[setup, AGAINST])
        for setup, method in cells
        if method != AGAINST and (setup, AGAINST) in cells
    ]


def _difference(condition: Condition, cell: Cell, scores: Scores, reference: Scores) -> dict[str, Any]:
    setup, method = cell
    shared = sorted(set(scores) & set(reference))
    differences = np.array([np.mean(scores[unit]) - np.mean(reference[unit]) for unit in shared])
    interval = p_value = None
    if shared:
        draws = stream(0, "report", "difference", setup, method, *condition)
        interval = bootstrap_interval(differences, _strata(shared), draws)
        p_value = paired_test(differences, stream(0, "report", "test", setup, method, *condition))
    return {
        "setup": setup,
        **condition_fields(condition),
        "method": method,
        "against": AGAINST,
        "trials": len(shared),
        "mean_difference": float(differences.mean()) if shared else None,
        "ci95": None if interval is None else list(interval),
        "p_value": p_value,
        "p_corrected": None,
    }


def _improvement(condition: Condition, cell: Cell, reference: Scores, other: Scores) -> dict[str, Any]:
    setup, method = cell
    shared = sorted(set(reference) & set(other))
    wins = np.array([share_of_wins(reference[unit], other[unit]) for unit in shared])
    interval = None
    if shared:
        draws = stream(0, "report", "improvement", setup, method, *condition)
        interval = bootstrap_interval(wins, _strata(shared), draws)
    return {
        "setup": setup,
        **condition_fields(condition),
        "method": AGAINST,
        "over": method,
        "trials": len(shared),
        "probability": float(wins.mean()) if shared else None,
        "ci95": None if interval is None else list(interval),
    }


def _profile(condition: Condition, method: str, scores: Scores) -> dict[str, Any]:
    units = sorted(scores)
    numbers = [i for i, unit in enumerate(units) for _ in scores[unit]]
    _, shares = shares_above([score for unit in units for score in scores[unit]], numbers, THRESHOLDS)
    band = bootstrap_band(shares, _strata(units), stream(0, "report", "profile", method, *condition))
    return {
        "setup": ALL,
        **condition_fields(condition),
        "method": method,
        "thresholds": list(THRESHOLDS),
        "share": shares.mean(axis=0).tolist(),
        "ci95": None if band is None else [end.tolist() for end in band],
    }


def _strata(units: Iterable[Unit]) -> list[int]:
    """The setup of every unit as a number."""
    return to_numbers(unit[0] for unit in units)
