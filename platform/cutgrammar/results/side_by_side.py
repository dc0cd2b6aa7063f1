"""Two runs side by side: what each scores on the trials that both have, and by how much they differ.

Trials are the same where data, setup, number and method are, and run r of one is compared with run r of the other. If
the runs of both are trained models, trials and models are taken as random, as everywhere; model r need not be the same
in both. If those of either are seeds of planning, every trial is averaged over its runs, and trials alone are random.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.methods.registry import describe_methods
from cutgrammar.results.comparisons import ALL, Cell, Condition, condition_fields
from cutgrammar.results.samples import ANY_MODEL, Unit, interval_of_mean, means_of, n_models, paired, paired_difference
from cutgrammar.results.score_table import Row, group_by_cell, has_several_models
from cutgrammar.results.statistics import holm
from cutgrammar.seeds import stream
from cutgrammar.trials.record import Record
from cutgrammar.trials.scores import Score, describe_scores

DIGITS = 12
"""Differences are rounded to so many decimals: equal scores averaged over different numbers of runs do not differ."""
Runs = Mapping[Unit, Mapping[str, Sequence[float]]]


@dataclass(frozen=True, eq=False)
class Side:
    """One of two runs, or of two sets of runs.

    Attributes:
        name: as tables call it.
        rows: of its ledgers.
    """

    name: str
    rows: Sequence[Row]


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Two runs; differences are those of the second from the first."""

    first: Side
    second: Side

    @cached_property
    def conditions(self) -> list[tuple[Condition, Condition]]:
        """The conditions that are compared: equal ones, and those that alone in each run have the same goals."""
        ours, others = list(self._cells[0]), list(self._cells[1])
        pairs = [(condition, condition) for condition in ours if condition in others]
        for goals in dict.fromkeys(goals for goals, *_ in ours):
            mine, theirs = ([c for c in conditions if c[0] == goals] for conditions in (ours, others))
            if len(mine) == len(theirs) == 1 and mine != theirs:
                pairs.append((mine[0], theirs[0]))
        return pairs

    @cached_property
    def runs_are_models(self) -> bool:
        """Whether the runs of both are trained models, rather than seeds of planning with one model."""
        return all(has_several_models(side.rows) for side in (self.first, self.second))

    @cached_property
    def scores(self) -> list[Score]:
        """Those that both know, the deciding one first."""
        known = [
            {name for row in side.rows for name, value in row.record.scores.items() if value is not None}
            for side in (self.first, self.second)
        ]
        return sorted(describe_scores(known[0] & known[1]), key=lambda score: score.name != DECIDING_SCORE)

    @cached_property
    def entries(self) -> list[dict[str, Any]]:
        """For each score, compared condition, setup and method: both means and their paired difference, as JSON data.

        P-values are those of the deciding score only; those over all setups are one family for the correction, those of
        single setups another.
        """
        found = []
        for score in self.scores:
            for conditions in self.conditions:
                entries = [self._entry(score.name, conditions, cell) for cell in self._shared(conditions)]
                entries = [entry for entry in entries if entry["trials"]]
                if score.name == DECIDING_SCORE:
                    _correct([entry for entry in entries if entry["setup"] == ALL])
                    _correct([entry for entry in entries if entry["setup"] != ALL])
                found += entries
        return found

    def differences(self, conditions: tuple[Condition, Condition]) -> dict[str, dict[str, list[float]]]:
        """Method -> setup -> the difference of the deciding score in each trial, averaged over its runs."""
        found: dict[str, dict[str, list[float]]] = {}
        for setup, method in self._shared(conditions):
            if setup != ALL:
                values = self._paired(DECIDING_SCORE, conditions, (setup, method))
                found.setdefault(method, {})[setup] = [
                    float(np.mean([np.mean(second) - np.mean(first) for second, first in models.values()]))
                    for models in values.values()
                ]
        return found

    def trials(self) -> list[tuple[Record, Record]]:
        """The records of every trial and run that both have, the greatest loss of the second run first."""
        found = []
        for mine, theirs in self.conditions:
            sides = [
                {
                    (row.unit, row.record.key.method, row.record.key.run): row.record
                    for row in side.rows
                    if condition == row.condition
                }
                for side, condition in ((self.first, mine), (self.second, theirs))
            ]
            found += [(sides[0][key], sides[1][key]) for key in sides[0].keys() & sides[1].keys()]
        return sorted(found, key=lambda pair: (pair[1].iou_strict - pair[0].iou_strict, pair[0].key))

    def to_json(self) -> dict[str, Any]:
        """The names of both runs and the entries."""
        return {"first": self.first.name, "second": self.second.name, "rows": self.entries}

    @cached_property
    def _cells(self) -> tuple[dict[Condition, dict[Cell, list[Row]]], dict[Condition, dict[Cell, list[Row]]]]:
        return group_by_cell(self.first.rows), group_by_cell(self.second.rows)

    @cached_property
    def _once(self) -> set[str]:
        """The methods of which one run stands for all."""
        names = (row.record.key.method for side in (self.first, self.second) for row in side.rows)
        return {method.name for method in describe_methods(names) if method.is_deterministic}

    def _shared(self, conditions: tuple[Condition, Condition]) -> list[Cell]:
        ours, others = (cells[condition] for cells, condition in zip(self._cells, conditions, strict=True))
        return [cell for cell in ours if cell in others]

    def _paired(
        self, score: str, conditions: tuple[Condition, Condition], cell: Cell
    ) -> dict[Unit, dict[str, tuple[Sequence[float], Sequence[float]]]]:
        """Trial -> model -> the runs of the second and of the first."""
        for_any = not self.runs_are_models or cell[1] in self._once
        first, second = (
            _runs(cells[condition][cell], score, for_any)
            for cells, condition in zip(self._cells, conditions, strict=True)
        )
        return paired(second, first)

    def _entry(self, score: str, conditions: tuple[Condition, Condition], cell: Cell) -> dict[str, Any]:
        shared = self._paired(score, conditions, cell)
        second, first = (
            means_of({unit: {model: pair[side] for model, pair in models.items()} for unit, models in shared.items()})
            for side in (0, 1)
        )
        differences = {
            unit: {model: round(second[unit][model] - first[unit][model], DIGITS) for model in models}
            for unit, models in shared.items()
        }
        names = (score, *cell, *conditions[0], *conditions[1])
        test = paired_difference(
            differences,
            stream(0, "report", "beside difference", *names),
            stream(0, "report", "beside test", *names),
        )
        if score != DECIDING_SCORE:
            del test["p_value"]
        sides: dict[str, Any] = {}
        for name, means in (("first", first), ("second", second)):
            values = [float(np.mean(list(models.values()))) for models in means.values()]
            sides[f"{name}_mean"] = float(np.mean(values)) if values else None
            sides[f"{name}_ci95"] = interval_of_mean(means, stream(0, "report", "beside", name, *names))
        worlds = {} if conditions[0] == conditions[1] else {"second_condition": condition_fields(conditions[1])}
        return {
            "score": score,
            "setup": cell[0],
            **condition_fields(conditions[0]),
            **worlds,
            "method": cell[1],
            "trials": len(shared),
            "models": n_models(differences),
            **sides,
            **test,
        }


def _runs(rows: Iterable[Row], score: str, for_any_model: bool) -> Runs:
    """The known scores of every trial in each of its runs, by the number of the run."""
    found: dict[Unit, dict[str, list[float]]] = {}
    for row in rows:
        if (value := row.record.scores.get(score)) is not None:
            model = ANY_MODEL if for_any_model else str(row.record.key.run)
            found.setdefault(row.unit, {}).setdefault(model, []).append(value)
    return found


def _correct(entries: Sequence[dict[str, Any]]) -> None:
    """Adds the p-values corrected for their number (Holm)."""
    for entry, corrected in zip(entries, holm([entry["p_value"] for entry in entries]), strict=True):
        entry["p_corrected"] = corrected
