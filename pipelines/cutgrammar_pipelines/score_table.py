"""The numbers of a report, from the rows of one or more ledgers: a pure function, the same for the same rows.

The unit is the trial averaged over its runs (see `trials.statistics`). Under "all" stand the means over all trials of
all setups, each trial counting once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from cutgrammar.seeds import stream
from cutgrammar.trials.record import Record
from cutgrammar.trials.setups import SETUPS
from cutgrammar.trials.statistics import bootstrap_interval, holm, paired_test, per_unit, std_over_runs

ALL = "all"
"""What stands for every setup together."""

AGAINST = "grammar"
"""The method that the others are tested against."""

METHODS = ("grammar", "guided", "bc", "qnet", "human", "expert", "expert-rough", "replay", "copy", "largest", "random")
"""The order of methods in tables; others follow by name."""

Condition = tuple[str, str, str]
"""Goals, world, perception."""

Unit = tuple[str, str, int]
"""Setup, data digest, trial."""


@dataclass(frozen=True)
class Row:
    """One row of a ledger and where its trial is from.

    Attributes:
        record: what came of the trial; runs of one number from two origins (say, seeds) are two runs.
        data: digest of the data set; trials of one number in two data sets are two trials.
    """

    record: Record
    data: str

    @property
    def condition(self) -> Condition:
        """Under which it was evaluated."""
        key = self.record.key
        return key.goals, key.world, key.perception

    @property
    def unit(self) -> Unit:
        """Which trial of which data."""
        return self.record.key.setup, self.data, self.record.key.trial

    @property
    def run(self) -> tuple[str, int]:
        """Which run of which evaluation."""
        return self.record.key.origin, self.record.key.run


def table_of(rows: Iterable[Row], timing: bool = True) -> dict[str, Any]:
    """The report: `{"schema": 1, "rows": [...], "tests": [...]}`.

    Args:
        rows: of the ledgers, in any order.
        timing: give the mean time a trial took.
    """
    ordered = sorted(rows, key=_identity)
    table = []
    tests: list[dict[str, Any]] = []
    for condition, group in groupby(ordered, key=lambda row: row.condition):
        by_cell: dict[tuple[str, str], list[Row]] = {}
        for row in group:
            for setup in (row.record.key.setup, ALL):
                by_cell.setdefault((setup, row.record.key.method), []).append(row)
        cells = sorted(by_cell, key=lambda cell: (_place(cell[0], (*SETUPS, ALL)), _place(cell[1], METHODS)))
        table += [_summary(setup, method, condition, by_cell[setup, method], timing) for setup, method in cells]
        found = [
            _comparison(setup, method, condition, by_cell[setup, method], by_cell[setup, AGAINST])
            for setup, method in cells
            if method != AGAINST and (setup, AGAINST) in by_cell
        ]
        # The question asked first is the one over all setups; those asked of each setup form a family of their own.
        for family in (
            [test for test in found if test["setup"] == ALL],
            [test for test in found if test["setup"] != ALL],
        ):
            for test, corrected in zip(family, holm([test["p_value"] for test in family]), strict=True):
                test["p_corrected"] = corrected
        tests += found
    return {"schema": 1, "rows": table, "tests": tests}


def _summary(setup: str, method: str, condition: Condition, rows: list[Row], timing: bool) -> dict[str, Any]:
    goals, world, perception = condition
    records = [row.record for row in rows]
    units, runs = _numbered(row.unit for row in rows), _numbered(row.run for row in rows)
    strict = [record.iou_strict for record in records]
    known = [i for i, record in enumerate(records) if record.iou is not None]
    matched = [record.iou for record in records if record.iou is not None]
    unique, means = per_unit(strict, units)
    setup_of = dict(zip(units, (record.key.setup for record in records), strict=True))
    interval = bootstrap_interval(
        means, _numbered(setup_of[unit] for unit in unique), stream(0, "report", setup, method, *condition)
    )
    summary = {
        "setup": setup,
        "goals": goals,
        "world": world,
        "perception": perception,
        "method": method,
        "trials": len(unique),
        "iou_mean": _mean(matched, [units[i] for i in known]),
        "iou_strict_mean": float(means.mean()),
        "iou_refined_mean": None,
        "spectral_mean": None,
        "agreement_mean": None,
        "human_rating_mean": None,
        "iou_std_runs": std_over_runs(matched, [runs[i] for i in known]) if known else None,
        "iou_strict_std_runs": std_over_runs(strict, runs),
        "iou_strict_ci95": None if interval is None else list(interval),
        "cuts_mean": _mean([record.cuts for record in records], units),
        "failures": sum(record.status in ("failed", "crashed") for record in records),
        "stuck": sum(record.status == "stuck" for record in records),
        "dead_ends": sum(record.dead_ends for record in records),
    }
    if timing:
        summary["seconds_mean"] = _mean([record.seconds for record in records], units)
    return summary


def _comparison(setup: str, method: str, condition: Condition, rows: list[Row], reference: list[Row]) -> dict[str, Any]:
    """`method` minus `AGAINST` in strict IoU, over the trials that both have."""
    goals, world, perception = condition
    ours, theirs = _by_unit(rows), _by_unit(reference)
    shared = sorted(set(ours) & set(theirs))
    differences = np.array([ours[unit] - theirs[unit] for unit in shared])
    interval = p_value = None
    if shared:
        draws = stream(0, "report", "difference", setup, method, *condition)
        interval = bootstrap_interval(differences, _numbered(unit[0] for unit in shared), draws)
        p_value = paired_test(differences, stream(0, "report", "test", setup, method, *condition))
    return {
        "setup": setup,
        "goals": goals,
        "world": world,
        "perception": perception,
        "method": method,
        "against": AGAINST,
        "mean_difference": float(differences.mean()) if shared else None,
        "ci95": None if interval is None else list(interval),
        "p_value": p_value,
        "p_corrected": None,
    }


def by_trial(rows: Iterable[Row]) -> dict[tuple[Condition, str], dict[Unit, float]]:
    """Strict IoU of every trial averaged over its runs, per (goals, world, perception) and method; for figures."""
    ordered = sorted(rows, key=lambda row: (row.condition, _place(row.record.key.method, METHODS), _identity(row)))
    groups = groupby(ordered, key=lambda row: (row.condition, row.record.key.method))
    return {key: _by_unit(list(group)) for key, group in groups}


def worst_first(records: Iterable[Record]) -> list[Record]:
    """Records by strict IoU, the lowest first."""
    return sorted(records, key=lambda record: (record.iou_strict, record.key))


def _by_unit(rows: Sequence[Row]) -> dict[Unit, float]:
    """Strict IoU of every trial averaged over its runs."""
    names = sorted({row.unit for row in rows})
    where = {name: i for i, name in enumerate(names)}
    _, means = per_unit([row.record.iou_strict for row in rows], [where[row.unit] for row in rows])
    return dict(zip(names, means.tolist(), strict=True))


def _mean(values: Sequence[float], units: Sequence[int]) -> float | None:
    """Mean over units of their means; None without any."""
    return float(per_unit(values, units)[1].mean()) if len(values) else None


def _numbered(names: Iterable[Any]) -> list[int]:
    """Names as whole numbers, by their order."""
    named = list(names)
    number = {name: i for i, name in enumerate(sorted(set(named)))}
    return [number[name] for name in named]


def _identity(row: Row) -> tuple[Any, ...]:
    return *row.condition, *row.unit, row.record.key.method, *row.run


def _place(name: str, order: Sequence[str]) -> tuple[int, str]:
    return (order.index(name) if name in order else len(order), name)
