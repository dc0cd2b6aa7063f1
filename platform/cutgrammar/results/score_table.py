"""The numbers of a report, from the rows of one or more ledgers: a pure function of these rows.

The unit is the trial averaged over its runs (see `statistics`). "all" names the means over the trials of all setups, in
which each trial counts once; `setup_means` has the means over setups.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.methods.registry import describe_methods
from cutgrammar.results.comparisons import (
    ALL,
    Cell,
    Condition,
    Unit,
    improvements,
    profiles,
    tests_against,
    to_numbers,
)
from cutgrammar.results.paper_table import printed_rows
from cutgrammar.results.statistics import bootstrap_interval, per_unit, std_over_runs
from cutgrammar.seeds import stream
from cutgrammar.trials.record import Record
from cutgrammar.trials.scores import describe_scores
from cutgrammar.trials.setups import SETUPS


@dataclass(frozen=True)
class Row:
    """One row of a ledger and the data of its trial.

    Attributes:
        record: of the trial; runs with one number from two origins (say, seeds) are two runs.
        data: digest of the data set; trials with one number in two data sets are two trials.
    """

    record: Record
    data: str

    @property
    def condition(self) -> Condition:
        """Goals, world and perception of the evaluation."""
        key = self.record.key
        return key.goals, key.world, key.perception

    @property
    def unit(self) -> Unit:
        """The trial within its data."""
        return self.record.key.setup, self.data, self.record.key.trial

    @property
    def run(self) -> tuple[str, int]:
        """The run within its evaluation."""
        return self.record.key.origin, self.record.key.run


def table_of(rows: Iterable[Row], timing: bool = True) -> dict[str, Any]:
    """An object with these lists and the digest of all results but times.

    - rows: the numbers of every method in every setup, and under "all" over all trials.
    - setup_means: the means over setups, in which each setup counts once, as in the paper's Table I.
    - tests, improvement, profiles: see `comparisons`.
    - paper: the numbers that the paper prints.
    - shown: the methods that see the trial's own demonstration.

    Args:
        rows: of the ledgers, in any order.
        timing: give the mean time of a trial.
    """
    ordered = sorted(rows, key=_identity)
    methods = describe_methods(row.record.key.method for row in ordered)
    names = [method.name for method in methods]
    digests = {id(row): row.record.digest for row in ordered}
    scored = [score.name for score in describe_scores(name for row in ordered for name in row.record.scores)]
    report: dict[str, Any] = {"schema": 1, "rows": [], "tests": [], "setup_means": [], "improvement": []}
    report |= {"profiles": [], "paper": printed_rows()}
    for condition, group in groupby(ordered, key=lambda row: row.condition):
        by_cell: dict[Cell, list[Row]] = {}
        for row in group:
            for setup in (row.record.key.setup, ALL):
                by_cell.setdefault((setup, row.record.key.method), []).append(row)
        cells = sorted(by_cell, key=lambda cell: (_place(cell[0], (*SETUPS, ALL)), names.index(cell[1])))
        summaries = [
            _summary(setup, method, condition, by_cell[setup, method], timing, scored)
            | {"digest": _digest(digests[id(row)] for row in by_cell[setup, method])}
            for setup, method in cells
        ]
        scores = {cell: _runs_of(by_cell[cell]) for cell in cells}
        report["rows"] += summaries
        report["tests"] += tests_against(condition, scores)
        report["setup_means"] += [
            _over_setups([row for row in summaries if row["method"] == method], by_cell[ALL, method], scored)
            for setup, method in cells
            if setup == ALL
        ]
        report["improvement"] += improvements(condition, scores)
        report["profiles"] += profiles(condition, scores)
    shown = [method.name for method in methods if method.sees_demonstration]
    return report | {"shown": shown, "digest": _digest(digests.values())}


def _score_fields(
    records: Sequence[Record], units: Sequence[int], runs: Sequence[int], names: Sequence[str]
) -> dict[str, float | None]:
    """NAME_mean, over trials, and NAME_std_runs of every score, from the records where it is known."""
    fields: dict[str, float | None] = {}
    for name in names:
        known = [
            (v, u, r)
            for record, u, r in zip(records, units, runs, strict=True)
            if (v := record.scores.get(name)) is not None
        ]
        values, of_units, of_runs = zip(*known, strict=True) if known else ((), (), ())
        fields[f"{name}_mean"] = _mean(values, of_units)
        fields[f"{name}_std_runs"] = std_over_runs(values, of_runs) if known else None
    return fields


def _summary(
    setup: str, method: str, condition: Condition, rows: list[Row], timing: bool, names: Sequence[str]
) -> dict[str, Any]:
    goals, world, perception = condition
    records = [row.record for row in rows]
    units, runs = to_numbers(row.unit for row in rows), to_numbers(row.run for row in rows)
    unique, means = per_unit([record.iou_strict for record in records], units)
    setup_of = dict(zip(units, (record.key.setup for record in records), strict=True))
    interval = bootstrap_interval(
        means, to_numbers(setup_of[unit] for unit in unique), stream(0, "report", setup, method, *condition)
    )
    summary = {
        "setup": setup,
        "goals": goals,
        "world": world,
        "perception": perception,
        "method": method,
        "trials": len(unique),
        **_score_fields(records, units, runs, names),
        f"{DECIDING_SCORE}_ci95": None if interval is None else list(interval),
        "cuts_mean": _mean([record.cuts for record in records], units),
        "failures": sum(record.status in ("failed", "crashed") for record in records),
        "stuck": sum(record.status == "stuck" for record in records),
        "dead_ends": sum(record.dead_ends for record in records),
    }
    if timing:
        summary["seconds_mean"] = _mean([record.seconds for record in records], units)
    return summary


def _over_setups(summaries: Sequence[Mapping[str, Any]], rows: Sequence[Row], scores: Sequence[str]) -> dict[str, Any]:
    """The means over setups of one method.

    Args:
        summaries: its entries of all setups and of `ALL`.
        rows: all its rows.
        scores: names.
    """
    single = [summary for summary in summaries if summary["setup"] != ALL]
    first = single[0]
    values = {
        name: [summary[name] for summary in single] for name in (*(f"{score}_mean" for score in scores), "cuts_mean")
    }
    units, means = per_unit([row.record.iou_strict for row in rows], to_numbers(row.unit for row in rows))
    names = sorted({row.unit for row in rows})
    interval = bootstrap_interval(
        means,
        to_numbers(names[unit][0] for unit in units),
        stream(0, "report", "setups", first["method"], first["goals"], first["world"], first["perception"]),
        balanced=True,
    )
    return {
        **{name: first[name] for name in ("goals", "world", "perception", "method")},
        "setups": len(single),
        **{name: None if None in found else float(np.mean(found)) for name, found in values.items()},
        **{f"{score}_std_runs": _std_over_setups(rows, score) for score in scores},
        f"{DECIDING_SCORE}_ci95": None if interval is None else list(interval),
    }


def _std_over_setups(rows: Sequence[Row], score: str) -> float | None:
    """Standard deviation, over the runs with a known score in every setup, of their mean over setups."""
    found: dict[tuple[str, int], dict[str, list[float]]] = {}
    for row in rows:
        if (value := row.record.scores.get(score)) is not None:
            found.setdefault(row.run, {}).setdefault(row.record.key.setup, []).append(value)
    setups = {row.record.key.setup for row in rows}
    means = [np.mean([np.mean(values) for values in run.values()]) for run in found.values() if len(run) == len(setups)]
    return std_over_runs(means, range(len(means))) if means else None


def by_trial(rows: Iterable[Row]) -> dict[tuple[Condition, str], dict[Unit, float]]:
    """Deciding score of every trial averaged over its runs: (condition, method) -> unit -> score."""
    rows = list(rows)
    names = [method.name for method in describe_methods(row.record.key.method for row in rows)]
    ordered = sorted(rows, key=lambda row: (row.condition, names.index(row.record.key.method), _identity(row)))
    groups = groupby(ordered, key=lambda row: (row.condition, row.record.key.method))
    return {key: {unit: float(np.mean(scores)) for unit, scores in _runs_of(group).items()} for key, group in groups}


def worst_first(records: Iterable[Record]) -> list[Record]:
    """Records by the deciding score, the lowest first."""
    return sorted(records, key=lambda record: (record.iou_strict, record.key))


def _runs_of(rows: Iterable[Row]) -> dict[Unit, list[float]]:
    """Deciding score of every trial in each of its runs, in the order of trials."""
    found: dict[Unit, list[float]] = {}
    for row in rows:
        found.setdefault(row.unit, []).append(row.record.iou_strict)
    return dict(sorted(found.items()))


def _mean(values: Sequence[float], units: Sequence[int]) -> float | None:
    """Mean over units of their means; None without values."""
    return float(per_unit(values, units)[1].mean()) if len(values) else None


def _digest(digests: Iterable[str]) -> str:
    """One digest for several records, in any order."""
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()


def _identity(row: Row) -> tuple[Any, ...]:
    return *row.condition, *row.unit, row.record.key.method, *row.run


def _place(name: str, order: Sequence[str]) -> tuple[int, str]:
    return (order.index(name) if name in order else len(order), name)
