"""The report of an evaluation: the tables and charts that follow from its numbers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.results.comparisons import AGAINST, ALL, Condition
from cutgrammar.results.report import (
    Cell,
    Column,
    Dot,
    DotChart,
    Item,
    Line,
    LineChart,
    Panel,
    Row,
    RowKind,
    Section,
    StripChart,
    Table,
    as_interval,
    columns,
    keys,
    words,
)
from cutgrammar.trials.scores import Score

Entry = Mapping[str, Any]
"""An entry of one of the lists of `score_table.table_of`."""

IN_PLACE = "in-place"
"""The paper's goals: where they were cut."""
SEES_DEMONSTRATION, NOT_INSTALLED = " †", " ‡"
"""Marks of methods that do not compete."""
FOLD_TESTS, FOLD_TRIALS = "Setup by setup", "Trial by trial"
FOLD_SCORES, FOLD_OUTCOMES = "The other scores, setup by setup", "How the trials went"


@dataclass(frozen=True)
class ConditionNumbers:
    """What the numbers of a report say about one condition.

    Attributes:
        rows, means, tests, improvement, profiles: entries of the lists of `score_table.table_of`.
        paper: what the paper prints.
        marks: method -> mark of one that does not compete.
        scores: those with a column, in the order of tables; the deciding one first.
        differences: method -> setup -> deciding score of each trial minus that of the reference method.
    """

    rows: Sequence[Entry]
    means: Sequence[Entry]
    tests: Sequence[Entry]
    improvement: Sequence[Entry]
    profiles: Sequence[Entry]
    paper: Sequence[Entry]
    marks: Mapping[str, str]
    scores: Sequence[Score]
    differences: Mapping[str, Mapping[str, tuple[float, ...]]]

    @property
    def methods(self) -> list[str]:
        """In the order of tables."""
        return list(dict.fromkeys(row["method"] for row in self.rows))

    @property
    def setups(self) -> list[str]:
        """Without `ALL`."""
        return [setup for setup in dict.fromkeys(row["setup"] for row in self.rows) if setup != ALL]

    @property
    def cells(self) -> dict[tuple[str, str], Entry]:
        """(setup, method) -> entry."""
        return {(row["setup"], row["method"]): row for row in self.rows}

    def name(self, method: str) -> Cell:
        """The method with its mark."""
        return Cell(method + self.marks.get(method, ""))

    def kind(self, method: str) -> RowKind:
        """The first method that does not compete is set apart from those above it."""
        first = next((name for name in self.methods if name in self.marks), None)
        return "apart" if method == first and method != self.methods[0] else ""


def condition_section(condition: Condition, numbers: ConditionNumbers) -> Section:
    """All that is said about one condition."""
    goals, world, perception = condition
    items: list[Item] = [_overview(numbers), _score_chart(numbers), _by_setup(numbers, numbers.scores[0])]
    if goals == IN_PLACE:
        items += _beside_the_paper(numbers)
    items += _against_reference(numbers)
    items.append(_profiles(numbers))
    items += _against_reference_by_setup(numbers)
    if numbers.differences:
        items.append(
            StripChart(
                f"Differences in {_deciding(numbers)} from {AGAINST}, trial by trial",
                "Each dot is a test trial averaged over its runs; the bar is the mean of a method.",
                f"{_deciding(numbers)} minus that of {AGAINST} (left: {AGAINST} is better)",
                numbers.differences,
                FOLD_TRIALS,
            )
        )
    items += [_by_setup(numbers, score, FOLD_SCORES) for score in numbers.scores[1:]]
    items.append(_outcomes(numbers))
    return Section(f"Goals {goals}", tuple(items), f"world {world}, perception {perception}")


def _overview(numbers: ConditionNumbers) -> Table:
    """Every method in one row: its scores over all setups and how its trials ended."""
    means, cells = {one["method"]: one for one in numbers.means}, numbers.cells
    deciding, *others = numbers.scores
    is_timed = all("seconds_mean" in row for row in numbers.rows)
    rows = []
    for method in numbers.methods:
        overall, mean = cells[ALL, method], means[method]
        row = [numbers.name(method), Cell(overall["trials"]), _score(mean, deciding), _score(overall, deciding)]
        row += [Cell(mean[f"{score.name}_mean"], ".3f") for score in others]
        row += [Cell(overall["cuts_mean"], ".1f")]
        row += [Cell(overall[name]) for name in ("failures", "stuck", "dead_ends")]
        row += [Cell(overall["seconds_mean"], ".1f")] if is_timed else []
        rows.append(Row(tuple(row), numbers.kind(method)))
    return Table(
        "Over all setups",
        (
            *keys("method"),
            *columns("n"),
            *(Column(heading, deciding.label) for heading in ("mean of setups", "mean of trials")),
            *columns(*map(_heading, others), "cuts", "failed", "stuck", "dead ends", *["seconds"] * is_timed),
        ),
        tuple(rows),
        f"Other scores: mean of setups. Cuts{' and seconds' * is_timed}: mean of a trial. Failed and stuck: runs; "
        "dead ends: cuts planned from one.",
    )


def _by_setup(numbers: ConditionNumbers, score: Score, fold: str = "") -> Table:
    """Methods down, setups across; the means over setups and over trials at the end."""
    cells, means = numbers.cells, {one["method"]: one for one in numbers.means}
    rows = []
    for method in numbers.methods:
        row = [numbers.name(method), *(_score(cells.get((setup, method)), score) for setup in numbers.setups)]
        row += [_score(means[method], score), _score(cells[ALL, method], score)]
        rows.append(Row(tuple(row), numbers.kind(method)))
    trials = {setup: max(row["trials"] for row in numbers.rows if row["setup"] == setup) for setup in numbers.setups}
    return Table(
        f"{_capital(_heading(score))} in each setup".replace("\n", " "),
        (
            *keys("method"),
            *(Column(setup, f"n = {trials[setup]}") for setup in numbers.setups),
            *columns("mean of setups", "mean of trials"),
        ),
        tuple(rows),
        fold=fold,
    )


def _beside_the_paper(numbers: ConditionNumbers) -> list[Item]:
    """Setups down; for each of the paper's methods what was reached here and what the paper prints."""
    methods = list(dict.fromkeys(one["method"] for one in numbers.paper))
    if not set(methods) & set(numbers.methods):
        return []
    ours = numbers.cells | {(ALL, one["method"]): one for one in numbers.means}
    printed: dict[tuple[str, str], Entry] = {(one["setup"], one["method"]): one for one in numbers.paper}
    printed |= {(ALL, method): _printed_mean(printed, numbers.setups, method) for method in methods}
    heads, rows = [*keys("setup")], []
    for method in methods:
        group = {AGAINST: f"{AGAINST} (paper: Ours)"}.get(method, method + numbers.marks.get(method, ""))
        known = method in numbers.methods
        heads += [Column(heading, group) for heading in (*["strict", "matched"] * known, "paper")]
    for setup in (*numbers.setups, ALL):
        row = [Cell("mean of setups" if setup == ALL else setup)]
        for method in methods:
            if method in numbers.methods:
                one = ours.get((setup, method), {})
                row += [
                    Cell(one.get(f"{name}_mean"), ".3f", one.get(f"{name}_std_runs"))
                    for name in (DECIDING_SCORE, "iou")
                ]
            paper = printed.get((setup, method), {})
            row.append(Cell(paper.get("iou_mean"), ".2f", paper.get("iou_std")))
        rows.append(Row(tuple(row), "total" if setup == ALL else ""))
    return [
        Table(
            "Table I: best-matched IoU here and as the paper prints it",
            tuple(heads),
            tuple(rows),
            "The paper's numbers are from other foods, demonstrations and meshes: they do not compare one to one.",
        )
    ]


def _against_reference(numbers: ConditionNumbers) -> list[Item]:
    """Every method against the reference method over all setups: difference, test, probability to be better."""
    tests = [test for test in numbers.tests if test["setup"] == ALL]
    wins = {one["over"]: one for one in numbers.improvement if one["setup"] == ALL}
    rows = [
        Row(
            (numbers.name(test["method"]), Cell(test["trials"]), *_test_cells(test, wins[test["method"]])),
            numbers.kind(test["method"]),
        )
        for test in tests
    ]
    title = f"{_capital(_deciding(numbers))} minus that of {AGAINST}, trial by trial, over all setups"
    return [Table(title, (*keys("method"), *columns("n"), *_test_columns()), tuple(rows))] if rows else []


def _against_reference_by_setup(numbers: ConditionNumbers) -> list[Item]:
    """The same for every setup by itself."""
    wins = {(one["setup"], one["over"]): one for one in numbers.improvement}
    rows = [
        Row(
            (
                Cell(test["setup"]),
                numbers.name(test["method"]),
                *_test_cells(test, wins[test["setup"], test["method"]]),
            )
        )
        for test in numbers.tests
        if test["setup"] != ALL
    ]
    title = f"{_capital(_deciding(numbers))} minus that of {AGAINST} in each setup"
    return [Table(title, (*keys("setup", "method"), *_test_columns()), tuple(rows), fold=FOLD_TESTS)] if rows else []


def _test_columns() -> tuple[Column, ...]:
    return columns("difference", "95 % interval", "p", "p (Holm)", f"P({AGAINST} above)", "95 % interval")


def _test_cells(test: Entry, win: Entry) -> tuple[Cell, ...]:
    return (
        Cell(test["mean_difference"], "+.3f"),
        Cell(as_interval(test["ci95"]), "+.3f"),
        Cell(test["p_value"], "p"),
        Cell(test["p_corrected"], "p"),
        Cell(win["probability"], ".3f"),
        Cell(as_interval(win["ci95"]), ".3f"),
    )


def _outcomes(numbers: ConditionNumbers) -> Table:
    """How the trials went, setup by setup."""
    is_timed = all("seconds_mean" in row for row in numbers.rows)
    rows = []
    for one in numbers.rows:
        row = [Cell(one["setup"]), numbers.name(one["method"]), Cell(one["cuts_mean"], ".1f")]
        row += [Cell(one[name]) for name in ("failures", "stuck", "dead_ends")]
        row += [Cell(one["seconds_mean"], ".2f")] if is_timed else []
        rows.append(Row((*row, Cell(one["digest"][:8], is_code=True))))
    return Table(
        "Cuts, endings and time of the trials in each setup",
        (
            *keys("setup", "method"),
            *columns("cuts a trial", "failed", "stuck", "dead ends", *["seconds a trial"] * is_timed),
            *words("digest"),
        ),
        tuple(rows),
        "Failed and stuck: runs of trials; dead ends: cuts planned from one; digest: of all but times.",
        FOLD_OUTCOMES,
    )


def _score_chart(numbers: ConditionNumbers) -> DotChart:
    """Deciding score with its interval: a panel for each setup, a line for each method."""
    panels = []
    for setup in (*numbers.setups, ALL):
        found = {row["method"]: row for row in numbers.rows if row["setup"] == setup}
        mean, ends = f"{DECIDING_SCORE}_mean", f"{DECIDING_SCORE}_ci95"
        dots = tuple(Dot(name, name, row[mean], as_interval(row[ends])) for name, row in found.items())
        panels.append(Panel(setup, dots, found[AGAINST][mean] if AGAINST in found else None))
    return DotChart(
        f"Mean {_deciding(numbers)} by setup and method with 95 % intervals",
        f"Mean {_deciding(numbers)} and its 95 % interval; the upright line is {AGAINST}.",
        tuple(numbers.methods),
        tuple(panels),
    )


def _profiles(numbers: ConditionNumbers) -> tuple[LineChart | DotChart, ...]:
    """Performance profiles and, beside them, the probability that the reference method is better."""
    label = _deciding(numbers)
    is_dashed = any(method in numbers.marks for method in numbers.methods)
    profiles = LineChart(
        f"Share of runs above every {label}, method by method",
        f"The share of runs whose {label} is above a threshold, with 95 % bands"
        + ("; dashed: methods that do not compete." if is_dashed else "."),
        tuple(
            Line(one["method"], tuple(one["thresholds"]), tuple(one["share"]), _band(one["ci95"]))
            for one in numbers.profiles
        ),
        label,
        "share of runs above it",
    )
    wins = [one for one in numbers.improvement if one["setup"] == ALL and one["probability"] is not None]
    if not wins:
        return (profiles,)
    dots = tuple(Dot(one["over"], one["over"], one["probability"], as_interval(one["ci95"])) for one in wins)
    improvement = DotChart(
        f"Probability that {AGAINST} scores above each other method",
        f"Probability that a run of {AGAINST} scores above a run of the method on the same trial.",
        tuple(one["over"] for one in wins),
        (Panel("", dots, 0.5),),
        f"P({AGAINST} scores above it)",
        is_narrow=True,
    )
    return profiles, improvement


def _band(ends: Sequence[Sequence[float]] | None) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    return None if ends is None else (tuple(ends[0]), tuple(ends[1]))


def _score(entry: Entry | None, score: Score) -> Cell:
    """The mean of a score with its spread over runs and its interval, where they are known."""
    if entry is None:
        return Cell(None)
    mean, ends = entry[f"{score.name}_mean"], as_interval(entry.get(f"{score.name}_ci95"))
    return Cell(mean, ".3f", entry.get(f"{score.name}_std_runs"), ends)


def _printed_mean(printed: Mapping[tuple[str, str], Entry], setups: Iterable[str], method: str) -> Entry:
    """The mean over setups of what the paper prints; unknown unless it prints all of them."""
    values = [printed[setup, method]["iou_mean"] if (setup, method) in printed else None for setup in setups]
    known = [value for value in values if value is not None]
    return {"iou_mean": sum(known) / len(known) if known and len(known) == len(values) else None, "iou_std": None}


def _deciding(numbers: ConditionNumbers) -> str:
    return numbers.scores[0].label


def _heading(score: Score) -> str:
    return score.label if score.higher_is_better else f"{score.label}\n(lower is better)"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
