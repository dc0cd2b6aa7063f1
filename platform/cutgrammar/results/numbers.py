"""The numbers of a report as data: computed once by `score_table`, laid out by `score_report`, and written as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cutgrammar.methods.method import Method
from cutgrammar.results.comparisons import ALL, Cell, Condition
from cutgrammar.results.paper_table import printed_rows
from cutgrammar.results.samples import Unit
from cutgrammar.trials.scores import Score

SEES_DEMONSTRATION, NOT_INSTALLED, BY_PEOPLE = " †", " ‡", " §"
"""Marks of methods that do not compete."""

Entry = Mapping[str, Any]
"""One entry of a list of `Numbers.to_json`."""


@dataclass(frozen=True, eq=False)
class ConditionNumbers:
    """The numbers of one condition.

    Attributes:
        condition: goals, world and perception.
        rows, setup_means, tests, improvement, profiles: entries, as in `Numbers.to_json`.
        references: the methods that the others are tested against.
        trials: method -> trial -> deciding score averaged over runs.
        marks: method -> mark of one that does not compete.
        scores: those that are known in any condition; the deciding one first, the others in the order of tables.
        runs_are_models: whether runs are trained models, rather than seeds of planning with one model.
    """

    condition: Condition
    rows: Sequence[Entry]
    setup_means: Sequence[Entry]
    tests: Sequence[Entry]
    improvement: Sequence[Entry]
    profiles: Sequence[Entry]
    references: Sequence[str]
    trials: Mapping[str, Mapping[Unit, float]]
    marks: Mapping[str, str]
    scores: Sequence[Score]
    runs_are_models: bool

    @property
    def methods(self) -> list[str]:
        """In the order of tables."""
        return list(dict.fromkeys(row["method"] for row in self.rows))

    @property
    def setups(self) -> list[str]:
        """Without `ALL`."""
        return [setup for setup in dict.fromkeys(row["setup"] for row in self.rows) if setup != ALL]

    @property
    def cells(self) -> dict[Cell, Entry]:
        """(setup, method) -> entry."""
        return {(row["setup"], row["method"]): row for row in self.rows}

    @property
    def means(self) -> dict[str, Entry]:
        """Method -> entry of its means over setups."""
        return {entry["method"]: entry for entry in self.setup_means}

    @property
    def label(self) -> str:
        """Of the deciding score."""
        return self.scores[0].label

    @property
    def is_timed(self) -> bool:
        """Whether the mean time of a trial is given."""
        return all("seconds_mean" in row for row in self.rows)


@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers of a report.

    Attributes:
        conditions: the numbers of each condition.
        methods: in the order of tables.
        marks, scores, runs_are_models: as in `ConditionNumbers`.
        digest: of all results but times.
    """

    conditions: tuple[ConditionNumbers, ...]
    methods: tuple[Method, ...]
    marks: Mapping[str, str]
    scores: Sequence[Score]
    runs_are_models: bool
    digest: str

    def to_json(self) -> dict[str, Any]:
        """An object with these lists and the digest.

        - rows: the numbers of every method in every setup, and under "all" over all trials.
        - setup_means: the means over setups, in which each setup counts once, as in the paper's Table I.
        - tests, improvement, profiles: see `comparisons`.
        - paper: the numbers that the paper prints.
        - shown: the methods that see the trial's own demonstration.
        """
        lists = {
            name: [entry for numbers in self.conditions for entry in getattr(numbers, name)]
            for name in ("rows", "tests", "setup_means", "improvement", "profiles")
        }
        shown = [method.name for method in self.methods if method.sees_demonstration]
        return {"schema": 1, **lists, "paper": printed_rows(), "shown": shown, "digest": self.digest}
