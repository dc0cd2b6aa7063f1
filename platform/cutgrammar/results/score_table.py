"""The numbers of a report, from the rows of one or more ledgers: a pure function of these rows.

The unit is the trial averaged over its runs (see `samples`). "all" names the means over the trials of all setups, in
which each trial counts once; `setup_means` has the means over setups.
"""

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.geometry.arrays import Floats
from cutgrammar.methods.method import Method
from cutgrammar.methods.registry import describe_methods
from cutgrammar.results.comparisons import (
    ALL,
    REFERENCES,
    Cell,
    Condition,
    condition_fields,
    improvements,
    profiles,
    shared_with,
    tests_against,
)
from cutgrammar.results.numbers import BY_PEOPLE, NOT_INSTALLED, SEES_DEMONSTRATION, ConditionNumbers, Entry, Numbers
from cutgrammar.results.samples import ANY_MODEL, Scores, Unit, interval_of_mean, means_of, to_numbers
from cutgrammar.results.statistics import mean_of, per_unit, std_over_runs
from cutgrammar.seeds import stream
from cutgrammar.storage.run_folder import RunFacts
from cutgrammar.trials.goals import GOALS
from cutgrammar.trials.record import FAILURES, Record
from cutgrammar.trials.scores import describe_scores
from cutgrammar.trials.setups import SETUPS

MEAN = "mean"
"""Stands for a setup: the mean over setups, each of which counts once, as in Table I."""


@dataclass(frozen=True)
class Row:
    """One row of a ledger and the data of its trial.

    Attributes:
        record: of the trial; runs with one number from two origins (say, seeds) are two runs.
        data: digest of the data set; trials with one number in two data sets are two trials.
        model: digest of the trained model.
        by_person: whether a person made the cuts. Different people do different goals, so their runs are no
            repetitions of one another: all count as one.
    """

    record: Record
    data: str
    model: str = ""
    by_person: bool = False

    @staticmethod
    def of(record: Record, facts: RunFacts) -> "Row":
        """The row of a record in the run with these facts."""
        model = record.model or facts.model_digests[facts.model_of(record.key.origin)]
        return Row(record, facts.data_digest, model)

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
        return self.record.key.origin, 0 if self.by_person else self.record.key.run


def ignore(done: int, total: int) -> None:
    """A `watch` that does nothing."""


def numbers_of(
    rows: Iterable[Row],
    timing: bool = True,
    against: Sequence[str] | None = None,
    watch: Callable[[int, int], object] = ignore,
) -> Numbers:
    """The numbers of the rows of ledgers.

    Args:
        rows: in any order.
        timing: give the mean time of a trial.
        against: the methods that the others are tested against; None for those of `REFERENCES`. Those that were not
            evaluated are left out.
        watch: called with the number of finished parts of the tables and their total.
    """
    rows = list(rows)
    methods = describe_methods(row.record.key.method for row in rows)
    rows = _with_people(rows, methods)
    digests = {id(row): row.record.digest for row in rows}
    marks = {method.name: _mark(method) for method in methods if not method.is_competitor}
    scores = describe_scores(name for row in rows for name in row.record.scores)
    names = [score.name for score in scores]
    known = {name for row in rows for name, value in row.record.scores.items() if value is not None}
    shown = sorted((score for score in scores if score.name in known), key=lambda score: score.name != DECIDING_SCORE)
    conditions, are_models = [], has_several_models(rows)
    grouped = group_by_cell(rows)
    done, total = 0, sum(len(cells) + 1 for cells in grouped.values())
    for condition, cells in grouped.items():
        runs = _runs_of_cells(cells, methods)
        references = [name for name in against or REFERENCES if (ALL, name) in cells]
        shared = {name: shared_with(name, runs) for name in references}
        entries, means = [], []
        for entry, mean in _entries(condition, cells, runs, timing, names):
            entries.append(entry)
            means += [mean] if mean is not None else []
            done += 1
            watch(done, total)
        of_cells = [_digest(digests[id(row)] for row in group) for group in cells.values()]
        conditions.append(
            ConditionNumbers(
                condition=condition,
                rows=[entry | {"digest": digest} for entry, digest in zip(entries, of_cells, strict=True)],
                setup_means=means,
                references=references,
                tests=[test for name in references for test in tests_against(name, condition, shared[name])],
                improvement=[entry for name in references for entry in improvements(name, condition, shared[name])],
                profiles=profiles(condition, runs),
                trials={method: _mean_of_runs(trials) for (setup, method), trials in runs.items() if setup == ALL},
                marks=marks,
                scores=shown,
                runs_are_models=are_models,
            )
        )
        done += 1
        watch(done, total)
    return Numbers(tuple(conditions), methods, marks, shown, are_models, _digest(digests.values()))


def table_of(rows: Iterable[Row], timing: bool = True) -> dict[str, Any]:
    """The numbers of the rows of ledgers as JSON data (see `numbers_of` and `Numbers.to_json`)."""
    return numbers_of(rows, timing).to_json()


def means_of_rows(rows: Iterable[Row], timing: bool = True) -> list[Entry]:
    """The rows and setup means of `numbers_of`, the latter under the setup `MEAN`, without digests.

    Tests, probabilities and profiles, which take most of the time, are left out.
    """
    rows = list(rows)
    methods = describe_methods(row.record.key.method for row in rows)
    names = [score.name for score in describe_scores(name for row in rows for name in row.record.scores)]
    found: list[Entry] = []
    for condition, cells in group_by_cell(_with_people(rows, methods)).items():
        for entry, mean in _entries(condition, cells, _runs_of_cells(cells, methods), timing, names):
            found += [entry] if mean is None else [entry, {"setup": MEAN, **mean}]
    return found


def _with_people(rows: Iterable[Row], methods: Iterable[Method]) -> list[Row]:
    """The rows with those of people marked."""
    people = {method.name for method in methods if method.is_person}
    return [replace(row, by_person=True) if row.record.key.method in people else row for row in rows]


def _runs_of_cells(cells: Mapping[Cell, Sequence[Row]], methods: Iterable[Method]) -> dict[Cell, Scores]:
    """Of every cell the deciding score of each trial in each run."""
    once = {method.name for method in methods if method.is_deterministic}
    return {cell: _runs_of(group, cell[1] in once) for cell, group in cells.items()}


def _entries(
    condition: Condition,
    cells: Mapping[Cell, Sequence[Row]],
    runs: Mapping[Cell, Scores],
    timing: bool,
    names: Sequence[str],
) -> Iterator[tuple[dict[str, Any], dict[str, Any] | None]]:
    """The entry of every cell and, with that of a method over all setups, that of its means over setups."""
    single: dict[str, list[Entry]] = {}
    for (setup, method), group in cells.items():
        of_cell = runs[setup, method]
        entry, mean = _summary((setup, method), condition, group, of_cell, timing, names), None
        if setup == ALL:
            mean = _over_setups(method, condition, single[method], group, of_cell, names)
        else:
            single.setdefault(method, []).append(entry)
        yield entry, mean


def _mark(method: Method) -> str:
    """The mark of a method that does not compete."""
    if method.sees_demonstration:
        return SEES_DEMONSTRATION
    return BY_PEOPLE if method.is_person else NOT_INSTALLED


def group_by_cell(rows: Iterable[Row]) -> dict[Condition, dict[Cell, list[Row]]]:
    """The rows of each setup and method, and of each method over all setups, in the order of tables."""
    conditions: dict[Condition, dict[Cell, list[Row]]] = {}
    for row in sorted(rows, key=_identity):
        cells = conditions.setdefault(row.condition, {})
        for setup in (row.record.key.setup, ALL):
            cells.setdefault((setup, row.record.key.method), []).append(row)
    methods = describe_methods(method for cells in conditions.values() for _, method in cells)
    names, setups = [method.name for method in methods], list(SETUPS)

    def place(cell: Cell) -> tuple[bool, int, str, int]:
        setup, method = cell
        return setup == ALL, setups.index(setup) if setup in setups else len(setups), setup, names.index(method)

    return {
        condition: {cell: cells[cell] for cell in sorted(cells, key=place)}
        for condition, cells in sorted(conditions.items(), key=lambda item: _place_of(item[0]))
    }


def _place_of(condition: Condition) -> tuple[int, Condition]:
    """Key to sort conditions by: goal conditions in their own order, any others after them by name."""
    goals = condition[0]
    return GOALS.index(goals) if goals in GOALS else len(GOALS), condition


def by_trial(rows: Iterable[Row]) -> dict[tuple[Condition, str], dict[Unit, float]]:
    """Deciding score of every trial averaged over its runs: (condition, method) -> unit -> score."""
    return {
        (condition, method): _mean_of_runs(_runs_of(group, True))
        for condition, cells in group_by_cell(rows).items()
        for (setup, method), group in cells.items()
        if setup == ALL
    }


def worst_first(records: Iterable[Record]) -> list[Record]:
    """Records by the deciding score, the lowest first."""
    return sorted(records, key=lambda record: (record.iou_strict, record.key.values))


def _summary(
    cell: Cell, condition: Condition, rows: Sequence[Row], runs: Scores, timing: bool, scores: Sequence[str]
) -> dict[str, Any]:
    """The numbers of one method in one setup, or over all."""
    setup, method = cell
    records = [row.record for row in rows]
    units, of_runs = to_numbers(row.unit for row in rows), to_numbers(row.run for row in rows)
    means = per_unit([record.iou_strict for record in records], of_runs)[1]
    summary = {
        "setup": setup,
        **condition_fields(condition),
        "method": method,
        "trials": len(runs),
        "runs": len(means),
        **_score_fields(records, units, of_runs, scores),
        f"{DECIDING_SCORE}_worst_run": float(means.min()) if len(means) > 1 else None,
        f"{DECIDING_SCORE}_ci95": interval_of_mean(means_of(runs), stream(0, "report", setup, method, *condition)),
        "cuts_mean": _mean([record.cuts for record in records], units),
        "failures": sum(record.status in FAILURES for record in records),
        "stuck": sum(record.status == "stuck" for record in records),
        "dead_ends": sum(record.dead_ends for record in records),
    }
    if timing:
        by_hand = rows[0].by_person  # carrying out what was cut before takes no time that means anything
        summary["seconds_mean"] = None if by_hand else _mean([record.seconds for record in records], units)
    return summary


def _score_fields(
    records: Sequence[Record], units: Sequence[int], runs: Sequence[int], names: Sequence[str]
) -> dict[str, float | None]:
    """NAME_mean, over trials, and NAME_std_runs of every score, from the records where it is known."""
    fields: dict[str, float | None] = {}
    for name in names:
        known = [
            (value, unit, run)
            for record, unit, run in zip(records, units, runs, strict=True)
            if (value := record.scores.get(name)) is not None
        ]
        values, of_units, of_runs = zip(*known, strict=True) if known else ((), (), ())
        fields[f"{name}_mean"] = _mean(values, of_units)
        fields[f"{name}_std_runs"] = std_over_runs(values, of_runs) if known else None
    return fields


def _over_setups(
    method: str,
    condition: Condition,
    summaries: Sequence[Entry],
    rows: Sequence[Row],
    runs: Scores,
    scores: Sequence[str],
) -> dict[str, Any]:
    """The means over setups of one method, from its entries of single setups and all its rows."""
    values = {
        name: [summary[name] for summary in summaries] for name in (*(f"{score}_mean" for score in scores), "cuts_mean")
    }
    rng = stream(0, "report", "setups", method, *condition)
    of_runs = _means_of_runs(rows, scores)
    means = of_runs[DECIDING_SCORE]
    return {
        **condition_fields(condition),
        "method": method,
        "setups": len(summaries),
        "runs": len(means),
        **{name: None if None in column else float(np.mean(column)) for name, column in values.items()},
        **{f"{score}_std_runs": float(np.std(of, ddof=1)) if len(of) > 1 else None for score, of in of_runs.items()},
        f"{DECIDING_SCORE}_worst_run": min(means) if len(means) > 1 else None,
        f"{DECIDING_SCORE}_ci95": interval_of_mean(means_of(runs), rng, balanced=True),
    }


def _means_of_runs(rows: Sequence[Row], names: Sequence[str]) -> dict[str, list[float]]:
    """Of each score, the mean over setups of every run that knows it in each of them."""
    runs: dict[tuple[str, int], dict[str, list[list[float]]]] = {}
    for row in rows:
        values = [math.nan if (value := row.record.scores.get(name)) is None else value for name in names]
        runs.setdefault(row.run, {}).setdefault(row.record.key.setup, []).append(values)
    n_setups = len({row.record.key.setup for row in rows})
    complete = [run.values() for run in runs.values() if len(run) == n_setups]
    means = [_column_means([_column_means(of_setup) for of_setup in run]) for run in complete]
    return {name: [float(mean[i]) for mean in means if not np.isnan(mean[i])] for i, name in enumerate(names)}


def _column_means(rows: ArrayLike) -> Floats:
    """(s,) means of the columns of (r, s) scores, each over the rows that know it (those not NaN), or else NaN."""
    columns = np.array(rows, dtype=np.float64).T.copy()
    is_unknown = np.isnan(columns)
    means = columns.mean(axis=1)
    for i in np.flatnonzero(is_unknown.any(axis=1) & ~is_unknown.all(axis=1)):
        means[i] = columns[i, ~is_unknown[i]].mean()
    return np.asarray(means)


def _runs_of(rows: Iterable[Row], for_any_model: bool) -> dict[Unit, dict[str, list[float]]]:
    """Deciding score of every trial in each of its runs, by model and in the order of trials."""
    scores: dict[Unit, dict[str, list[float]]] = {}
    for row in rows:
        model = ANY_MODEL if for_any_model else row.model
        scores.setdefault(row.unit, {}).setdefault(model, []).append(row.record.iou_strict)
    return dict(sorted(scores.items()))


def has_several_models(rows: Iterable[Row]) -> bool:
    """Whether a data set has trials with more than one model; people use none."""
    models: dict[str, set[str]] = {}
    for row in rows:
        if row.by_person:
            continue
        models.setdefault(row.data, set()).add(row.model)
    return any(len(of_data) > 1 for of_data in models.values())


def _mean_of_runs(scores: Scores) -> dict[Unit, float]:
    return {unit: mean_of([score for runs in models.values() for score in runs]) for unit, models in scores.items()}


def _mean(values: Sequence[float], units: Sequence[int]) -> float | None:
    """Mean over units of their means; None without values."""
    return float(per_unit(values, units)[1].mean()) if len(values) else None


def _digest(digests: Iterable[str]) -> str:
    """One digest for several records, in any order."""
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()


def _identity(row: Row) -> tuple[Any, ...]:
    return *row.condition, *row.unit, row.record.key.method, row.record.key.origin, row.record.key.run
