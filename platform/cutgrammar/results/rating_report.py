"""What a report says of people's ratings: a section of its own, and fields in the rows of its numbers."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from cutgrammar.results.comparisons import ALL, Condition
from cutgrammar.results.human_rating import MAX_MISSED, MIN_CHECKS, NAME, HumanRatings
from cutgrammar.results.numbers import ConditionNumbers, Entry, Numbers
from cutgrammar.results.paper_table import COLUMNS, PRINTED_RATINGS
from cutgrammar.results.report import (
    Cell,
    Column,
    Dot,
    DotChart,
    Item,
    Panel,
    Row,
    Section,
    Table,
    as_interval,
    columns,
    keys,
    words,
)
from cutgrammar.storage.ratings import HIGHEST, LOWEST

IN_PLACE = "in-place"
TERMS = (
    (
        "human rating",
        f"How well the result matches the goal, from {LOWEST} to {HIGHEST}, by people who do not see the method: mean "
        "± standard deviation of the single ratings, as in Table I. The 95 % interval takes raters and trials both as "
        "random (pigeonhole bootstrap); it is unknown with one rater, or where a setup has one rated trial.",
    ),
    (
        "alpha",
        "Krippendorff's alpha of the ratings on their ordinal scale: 1 is perfect agreement of the raters, 0 is what "
        "chance would give.",
    ),
    (
        "raters who count",
        f"People, not test robots, who answered at least {MIN_CHECKS} attention checks (a goal beside itself, a goal "
        f"beside another) and missed at most {MAX_MISSED:.0%} of them.",
    ),
)
"""(term, explanation), ... for the glossary."""


def with_ratings(numbers: Numbers, ratings: HumanRatings) -> Numbers:
    """The numbers with the ratings in their rows."""
    return replace(numbers, conditions=tuple(_with_ratings(one, ratings) for one in numbers.conditions))


def _with_ratings(numbers: ConditionNumbers, ratings: HumanRatings) -> ConditionNumbers:
    cells = ratings.fields.get(numbers.condition, {})
    means = ratings.over_setups.get(numbers.condition, {})
    rows: list[Entry] = [{**row, **cells.get((row["setup"], row["method"]), {})} for row in numbers.rows]
    over: list[Entry] = [{**row, **means.get(row["method"], {})} for row in numbers.setup_means]
    return replace(numbers, rows=rows, setup_means=over)


def rating_notes(ratings: HumanRatings) -> list[str]:
    """A note on the raters who do not count, for each reason."""
    reasons: dict[str, list[str]] = {}
    for verdict in ratings.raters:
        if verdict.reason:
            reasons.setdefault(verdict.reason, []).append(verdict.rater)
    return [f"ratings of {', '.join(raters)} do not count: {reason}" for reason, raters in reasons.items()]


def ratings_section(ratings: HumanRatings, numbers: Numbers) -> Section:
    """The ratings of all methods, how far the raters agree, and who they are."""
    counting = [verdict for verdict in ratings.raters if not verdict.reason]
    alpha = "unknown" if ratings.alpha is None else f"{ratings.alpha:.2f}"
    lead = (
        f"{len(counting)} of {len(ratings.raters)} raters count. Krippendorff's alpha is {alpha}, from "
        f"{ratings.shared} pairs that two or more of them rated."
    )
    items: list[Item] = []
    for condition in numbers.conditions:
        if means := ratings.over_setups.get(condition.condition):
            items += [_by_setup(condition, ratings), _chart(condition, means)]
            if condition.condition[0] == IN_PLACE and set(COLUMNS) & set(means):
                items.append(_beside_the_paper(condition, ratings))
    return Section("Human rating", (*items, _raters(ratings)), lead=lead)


def _by_setup(numbers: ConditionNumbers, ratings: HumanRatings) -> Table:
    cells, means = ratings.fields[numbers.condition], ratings.over_setups[numbers.condition]
    methods = [method for method in numbers.methods if method in means]
    setups = [setup for setup in numbers.setups if any((setup, method) in cells for method in methods)]
    rows = []
    for method in methods:
        overall = cells[ALL, method]
        row = [Cell(method + numbers.marks.get(method, ""))]
        row += [_rating(cells.get((setup, method))) for setup in setups]
        row += [_rating(means[method]), Cell(overall[f"{NAME}_ratings"]), Cell(overall[f"{NAME}_raters"])]
        rows.append(Row(tuple(row)))
    return Table(
        f"Human rating in each setup{_where(numbers.condition)}",
        (*keys("method"), *columns(*setups, "mean of setups", "ratings", "raters")),
        tuple(rows),
        "± standard deviation of single ratings; below, the 95 % interval of the mean, where it is known. The mean of "
        "setups is over those that were rated.",
        tells_intervals=True,
    )


def _chart(numbers: ConditionNumbers, means: Mapping[str, Mapping[str, Any]]) -> DotChart:
    methods = tuple(method for method in numbers.methods if method in means)
    dots = tuple(
        Dot(method, method, means[method][f"{NAME}_mean"], as_interval(means[method][f"{NAME}_ci95"]))
        for method in methods
    )
    return DotChart(
        f"Human rating{_where(numbers.condition)}",
        "Mean over the rated setups with its 95 % interval, where it is known.",
        methods,
        (Panel("", dots, None),),
        "human rating",
        (float(LOWEST), float(HIGHEST)),
    )


def _beside_the_paper(numbers: ConditionNumbers, ratings: HumanRatings) -> Table:
    """Setups down; for each of the paper's methods the rating here and the one that the paper prints."""
    cells, means = ratings.fields[numbers.condition], ratings.over_setups[numbers.condition]
    shown = [method for method in COLUMNS if method in means]
    heads = [*keys("setup")]
    for method in shown:
        heads += [Column(name, method) for name in ("here", "paper")]
    rows = []
    for setup in (setup for setup in numbers.setups if setup in PRINTED_RATINGS):
        row = [Cell(setup)]
        for method in shown:
            mean, spread = PRINTED_RATINGS[setup][COLUMNS.index(method)]
            row += [_rating(cells.get((setup, method))), Cell(mean, ".2f", spread)]
        rows.append(Row(tuple(row)))
    note = "Other raters, foods and demonstrations: the numbers do not compare one to one."
    title = "Table I: Human Rating here and as the paper prints it"
    return Table(title, tuple(heads), tuple(rows), note, tells_intervals=True)


def _raters(ratings: HumanRatings) -> Table:
    rows = []
    for one in ratings.raters:
        counts = f"no: {one.reason}" if one.reason else "yes"
        cells = (Cell(one.rater), *(Cell(n) for n in (one.ratings, one.changed, one.checks, one.missed)), Cell(counts))
        rows.append(Row(cells, "bad" if one.reason else ""))
    heads = (*keys("rater"), *columns("pairs", "changed", "checks", "missed"), *words("counts"))
    return Table("Raters and their attention checks", heads, tuple(rows))


def _rating(fields: Mapping[str, Any] | None) -> Cell:
    if fields is None:
        return Cell(None)
    return Cell(fields[f"{NAME}_mean"], ".2f", fields[f"{NAME}_std"], as_interval(fields[f"{NAME}_ci95"]))


def _where(condition: Condition) -> str:
    goals, world, perception = condition
    return f", goals {goals}, world {world}, perception {perception}"
