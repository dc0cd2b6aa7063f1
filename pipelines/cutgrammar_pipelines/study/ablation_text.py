"""The summary of ablations as titled tables of words, the same for a terminal and for a page."""

import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

from cutgrammar.results.comparisons import ALL

READ = (
    " Base: the study's own settings. Difference: strict IoU minus that of base, trial by trial, with its 95 % "
    "interval and the p-value of a paired permutation test, corrected for all variants of the method (Holm). The same "
    "holds below."
)
"""How to read the tables of variants; said once."""


class Section(NamedTuple):
    """A titled table.

    Attributes:
        title: in a few words.
        note: what a reader must know of it.
        headings: of the columns; the first `names` of them hold words, the rest numbers.
        rows: their cells.
        names: number of columns that hold words.
    """

    title: str
    note: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    names: int


def sections_of(summary: dict[str, Any]) -> list[Section]:
    """The tables of a summary: one a question and condition, then training seeds, oracles and transfers."""
    found: list[Section] = []
    for question, goals in _unique((row["question"], row["goals"]) for row in summary["rows"]):
        of_question = [r for r in summary["rows"] if (r["question"], r["goals"]) == (question, goals)]
        found.append(_question(question, goals, of_question, explain=not found))
    found += [_training_seeds(summary["training_seeds"])] if summary["training_seeds"] else []
    for goals in _unique(row["goals"] for row in summary["oracles"]):
        found.append(_oracles(goals, [row for row in summary["oracles"] if row["goals"] == goals]))
    for name, goals in _unique((row["transfer"], row["goals"]) for row in summary["transfers"]):
        of_transfer = [r for r in summary["transfers"] if (r["transfer"], r["goals"]) == (name, goals)]
        found.append(_transfer(name, goals, of_transfer))
    return found


def as_text(sections: Sequence[Section], width: int) -> str:
    """The tables as plain text; notes are wrapped to `width` columns, tables are as wide as they are."""
    return "\n\n".join(_aligned(section, width) for section in sections) + "\n"


def _question(question: str, goals: str, rows: list[dict[str, Any]], explain: bool) -> Section:
    base, first = rows[0], next((row for row in rows if row["variant"] != "base"), rows[0])
    note = f"{first['trials']} test trials, {first['runs']} run{'s' * (first['runs'] > 1)} each." + (
        READ if explain else ""
    )
    changed = [_changed(row, base) for row in rows]
    cells = tuple(
        (
            row["variant"],
            what,
            row["method"],
            str(row["k"]),
            _spread(row["iou_strict_mean"], row["iou_strict_std_runs"]),
            *_compared(row),
            str(row["stuck"]),
            str(row["dead_ends"]),
            f"{row['seconds_mean']:.1f}" if "seconds_mean" in row else "-",
        )
        for row, what in zip(rows, changed, strict=True)
    )
    headings = ("variant", "what is changed", "method", "k", "strict IoU", "difference", "95 % interval", "p (Holm)")
    return Section(f"{question} (goals {goals})", note, (*headings, "stuck", "dead ends", "seconds"), cells, 3)


def _changed(row: dict[str, Any], base: dict[str, Any]) -> str:
    told = [f"{name} {value}" for name, value in row["changes"].items()]
    for name, word in (("training_trials", "training trials"), ("training_seed", "training seed")):
        if row[name] != base[name]:
            told.append(f"{word} {row[name]}")
    return ", ".join(told) or "-"


def _training_seeds(rows: list[dict[str, Any]]) -> Section:
    cells = tuple(
        (
            row["goals"],
            row["method"],
            " ".join(map(str, row["training_seeds"])),
            " ".join(f"{mean:.3f}" for mean in row["iou_strict_means"]),
            f"{row['iou_strict_mean']:.3f}",
            f"{row['iou_strict_std_seeds']:.3f}",
        )
        for row in rows
    )
    note = "Models that differ in the seed of their training alone: encoder, grammar and networks are all learned anew."
    return Section(
        "Training seeds", note, ("goals", "method", "seeds", "strict IoU", "mean", "std over seeds"), cells, 2
    )


def _oracles(goals: str, rows: list[dict[str, Any]]) -> Section:
    note = (
        "Each oracle knows all that those before it know. What a step adds to the strict IoU stands with its 95 % "
        "interval; the remainder to 1 is what the demonstration's own planes lose to the metric."
    )
    steps = list(rows[0]["scores"])
    cells = []
    for row in rows:
        line = [row["setup"], str(row["trials"]), f"{row['scores'][steps[0]]:.3f}"]
        for step in row["adds"]:
            interval = f" ({_interval(step['ci95'], '+')})" if row["setup"] == ALL and step["ci95"] else ""
            line += [f"{row['scores'][step['oracle']]:.3f}", f"{step['mean_difference']:+.3f}{interval}"]
        cells.append((*line, f"{row['remainder']:.3f}"))
    headings = ["setup", "n", steps[0], *(word for step in steps[1:] for word in (step, "adds")), "remainder"]
    return Section(f"What each oracle adds (goals {goals})", note, tuple(headings), tuple(cells), 1)


def _transfer(name: str, goals: str, rows: list[dict[str, Any]]) -> Section:
    note = (
        f"One model for both foods, learned from {rows[0]['training_trials']} trials with {rows[0]['trained']} alone. "
        f"Difference: strict IoU minus that of {rows[0]['against']} on the same food; p: corrected (Holm)."
    )
    cells = tuple(
        (
            row["tested"],
            row["method"],
            str(row["trials"]),
            _spread(row["iou_strict_mean"], row["iou_strict_std_runs"]),
            _interval(row["iou_strict_ci95"]),
            *_compared(row),
        )
        for row in rows
    )
    headings = ("tested on", "method", "n", "strict IoU", "95 % interval", "difference", "95 % interval", "p (Holm)")
    return Section(f"{name} (goals {goals})", note, headings, cells, 2)


def _compared(row: dict[str, Any]) -> tuple[str, str, str]:
    if row["mean_difference"] is None:
        return "-", "-", "-"
    p = row["p_corrected"]
    told = "-" if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"
    return f"{row['mean_difference']:+.3f}", _interval(row["ci95"], "+"), told


def _spread(mean: float | None, spread: float | None) -> str:
    if mean is None:
        return "-"
    return f"{mean:.3f}" if spread is None else f"{mean:.3f} +- {spread:.3f}"


def _interval(ends: Sequence[float] | None, sign: str = "") -> str:
    return "-" if ends is None else f"{ends[0]:{sign}.3f} to {ends[1]:{sign}.3f}"


def _aligned(section: Section, width: int) -> str:
    table = (section.headings, *section.rows)
    sizes = [max(len(row[i]) for row in table) for i in range(len(section.headings))]

    def line(row: Sequence[str]) -> str:
        cells = [
            c.ljust(s) if i < section.names else c.rjust(s) for i, (c, s) in enumerate(zip(row, sizes, strict=True))
        ]
        return "  ".join(cells).rstrip()

    rule = "-" * (sum(sizes) + 2 * (len(sizes) - 1))
    return "\n".join(
        [section.title, *textwrap.wrap(section.note, width), line(section.headings), rule, *map(line, section.rows)]
    )


def _unique(names: Any) -> list[Any]:
    return list(dict.fromkeys(names))
