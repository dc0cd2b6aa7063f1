"""The report of ablations, oracles and transfers: tables and a chart of differences from their numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

from cutgrammar.results.comparisons import ALL
from cutgrammar.results.report import (
    Cell,
    Dot,
    DotChart,
    Panel,
    Report,
    Row,
    Section,
    Table,
    as_interval,
    columns,
    keys,
    words,
)

Entry = Mapping[str, Any]
"""An entry of one of the lists of the summary (see `ablation_table`)."""

TITLE = "Cutting objects into fragments: what matters"
LEAD = (
    "The effects of single changes: of settings, the training seed, the number of training trials; what each oracle "
    "adds; and how well a model cuts foods that it was not trained on. All scores are strict IoU: the sum over matched "
    "pairs, divided by the larger number of fragments. The data are our own, not the paper's."
)
GLOSSARY = (
    ("base", "The study's own settings."),
    (
        "difference",
        "Strict IoU minus that of base, trial by trial, with its 95 % interval and the p-value of a paired permutation "
        "test, corrected for all variants of the method (Holm).",
    ),
)


def ablation_report(summary: Mapping[str, Any]) -> Report:
    """The report of a summary: a table for each question and condition, then training seeds, oracles and transfers."""
    rows = summary["rows"]
    sections = [_forests(rows)]
    for question, goals in dict.fromkeys((row["question"], row["goals"]) for row in rows):
        sections.append(
            _question(question, goals, [r for r in rows if (r["question"], r["goals"]) == (question, goals)])
        )
    sections += [_training_seeds(summary["training_seeds"])] if summary["training_seeds"] else []
    for goals in dict.fromkeys(row["goals"] for row in summary["oracles"]):
        sections.append(_oracles(goals, [row for row in summary["oracles"] if row["goals"] == goals]))
    for name, goals in dict.fromkeys((row["transfer"], row["goals"]) for row in summary["transfers"]):
        chosen = [row for row in summary["transfers"] if (row["transfer"], row["goals"]) == (name, goals)]
        sections.append(_transfer(name, goals, chosen))
    series = tuple(dict.fromkeys(row["method"] for row in rows))
    return Report(TITLE, LEAD, summary, tuple(s for s in sections if s.items), GLOSSARY, series=series)


def _forests(rows: Sequence[Entry]) -> Section:
    """A chart for each goal condition: the differences of all variants, with a line a variant and a dot a method."""
    charts = []
    for goals in dict.fromkeys(row["goals"] for row in rows):
        compared = [row for row in rows if row["goals"] == goals and row["mean_difference"] is not None]
        if not compared:
            continue
        lines = dict.fromkeys((row["question"], row["variant"]) for row in compared)
        questions = list(dict.fromkeys(question for question, _ in lines))
        dots = tuple(
            Dot(row["variant"], row["method"], row["mean_difference"], as_interval(row["ci95"])) for row in compared
        )
        charts.append(
            DotChart(
                "Differences in strict IoU from the study's own settings, variant by variant",
                f"Goals {goals}: strict IoU of every variant minus that of base, with 95 % intervals.",
                tuple(variant for _, variant in lines),
                (Panel("", dots, 0.0),),
                "difference in strict IoU (left: worse than the study's own settings)",
                x_range=None,
                groups=tuple(questions.index(question) for question, _ in lines),
                has_legend=True,
            )
        )
    return Section("Differences", tuple(charts), is_detail=True)


def _question(question: str, goals: str, rows: Sequence[Entry]) -> Section:
    base, first = rows[0], next((row for row in rows if row["variant"] != "base"), rows[0])
    body = tuple(
        _row(
            Cell(row["variant"]),
            Cell(_changes(row, base)),
            Cell(row["method"]),
            Cell(row["k"]),
            Cell(row["iou_strict_mean"], ".3f", row["iou_strict_std_runs"]),
            *_compared(row),
            Cell(row["stuck"]),
            Cell(row["dead_ends"]),
            Cell(row["seconds_mean"], ".1f"),
        )
        for row in rows
    )
    heads = (
        *keys("variant"),
        *words("what is changed", "method"),
        *columns("k", "strict IoU", "difference", "95 % interval", "p (Holm)", "stuck", "dead ends", "seconds"),
    )
    note = f"{first['trials']} test trials, {first['runs']} run{'s' * (first['runs'] > 1)} each."
    return Section(question, (Table("", heads, body, note),), f"goals {goals}")


def _changes(row: Entry, base: Entry) -> str:
    changed = [f"{name} {value}" for name, value in row["changes"].items()]
    for name, label in (("training_trials", "training trials"), ("training_seed", "training seed")):
        if row[name] != base[name]:
            changed.append(f"{label} {row[name]}")
    return ", ".join(changed) or "–"


def _training_seeds(rows: Sequence[Entry]) -> Section:
    body = tuple(
        _row(
            Cell(row["goals"]),
            Cell(row["method"]),
            Cell(" ".join(map(str, row["training_seeds"]))),
            Cell(" ".join(f"{mean:.3f}" for mean in row["iou_strict_means"])),
            Cell(row["iou_strict_mean"], ".3f"),
            Cell(row["iou_strict_std_seeds"], ".3f"),
        )
        for row in rows
    )
    heads = (*keys("goals", "method"), *columns("seeds", "strict IoU", "mean", "std over seeds"))
    note = "Models that differ in the seed of their training alone: encoder, grammar and networks are all learned anew."
    return Section("Training seeds", (Table("", heads, body, note),))


def _oracles(goals: str, rows: Sequence[Entry]) -> Section:
    note = (
        "Each oracle knows everything that those before it know. What it adds to the strict IoU has its 95 % interval; "
        "the remainder to 1 is what even the demonstration's own planes lose."
    )
    steps = list(rows[0]["scores"])
    body = []
    for row in rows:
        cells = [Cell(row["setup"]), Cell(row["trials"]), Cell(row["scores"][steps[0]], ".3f")]
        for step in row["adds"]:
            cells += [Cell(row["scores"][step["oracle"]], ".3f"), Cell(step["mean_difference"], "+.3f")]
            cells.append(Cell(as_interval(step["ci95"]), "+.3f"))
        cells.append(Cell(row["remainder"], ".3f"))
        body.append(Row(tuple(cells), "total" if row["setup"] == ALL else ""))
    adds = [heading for step in steps[1:] for heading in (step, "adds", "95 % interval")]
    heads = (*keys("setup"), *columns("n", steps[0], *adds, "remainder"))
    return Section("What each oracle adds", (Table("", heads, tuple(body), note),), f"goals {goals}")


def _transfer(name: str, goals: str, rows: Sequence[Entry]) -> Section:
    note = (
        f"One model for both foods, learned from {rows[0]['training_trials']} trials with {rows[0]['trained']} alone. "
        f"Difference: strict IoU minus that of {rows[0]['against']} on the same food; p: corrected (Holm)."
    )
    body = tuple(
        _row(
            Cell(row["tested"]),
            Cell(row["method"]),
            Cell(row["trials"]),
            Cell(row["iou_strict_mean"], ".3f", row["iou_strict_std_runs"]),
            Cell(as_interval(row["iou_strict_ci95"]), ".3f"),
            *_compared(row),
        )
        for row in rows
    )
    numbers = columns("n", "strict IoU", "95 % interval", "difference", "95 % interval", "p (Holm)")
    return Section(name, (Table("", (*keys("tested on", "method"), *numbers), body, note),), f"goals {goals}")


def _compared(row: Entry) -> tuple[Cell, ...]:
    difference = Cell(row["mean_difference"], "+.3f")
    return difference, Cell(as_interval(row["ci95"]), "+.3f"), Cell(row["p_corrected"], "p")


def _row(*cells: Cell) -> Row:
    return Row(cells)
