"""A report as a table of plain text, in the manner of the paper's Table I."""

import textwrap
from collections.abc import Sequence
from typing import Any

from cutgrammar_pipelines.comparisons import AGAINST, ALL

LEAST_WIDTH = 40


def as_text(report: dict[str, Any], width: int = 100) -> str:
    """The report as plain text no wider than `width` columns (at least `LEAST_WIDTH`).

    Args:
        report: what `build_report` made.
        width: columns of the terminal.
    """
    width = max(width, LEAST_WIDTH)
    if not report["rows"]:
        return "\n".join(["No trial has been evaluated yet.", *_notes(report, width)])
    parts = []
    for condition in _unique(map(_condition, report["rows"])):
        rows = [row for row in report["rows"] if _condition(row) == condition]
        parts.append("Goals {}, world {}, perception {}".format(*condition))
        parts.append(_score_block("Strict IoU (sum over the larger count; decides)", rows, "iou_strict", width))
        parts.append(_score_block("Matched IoU (matched pairs, the paper's)", rows, "iou", width))
        parts.append(_outcomes(rows, width))
        parts.append(_tests([test for test in report["tests"] if _condition(test) == condition], width))
    parts.append("\n".join([*_legend(width), *_notes(report, width)]))
    return "\n\n".join(part for part in parts if part)


def _score_block(title: str, rows: list[dict[str, Any]], score: str, width: int) -> str:
    """Setups down, methods across; as many methods in a block as fit the width."""
    methods, setups = _unique(r["method"] for r in rows), _unique(r["setup"] for r in rows)
    cells = {(r["setup"], r["method"]): _score(r[f"{score}_mean"], r[f"{score}_std_runs"]) for r in rows}
    trials = {r["setup"]: str(max(o["trials"] for o in rows if o["setup"] == r["setup"])) for r in rows}
    wide = max(len(text) for text in (*methods, *cells.values())) + 2
    first = max(len(setup) for setup in (*setups, "setup")) + max(len(n) for n in (*trials.values(), "n")) + 2
    across = max(1, (width - first) // wide)
    blocks = []
    for begin in range(0, len(methods), across):
        shown = methods[begin : begin + across]
        lines = [_line("setup", "n", shown, first, wide), "-" * (first + wide * len(shown))]
        for setup in setups:
            if setup == ALL and len(setups) > 1:
                lines.append(lines[1])
            lines.append(_line(setup, trials[setup], [cells.get((setup, m), "-") for m in shown], first, wide))
        blocks.append("\n".join(lines))
    return "\n\n".join([f"{title}\n{blocks[0]}", *blocks[1:]])


def _outcomes(rows: list[dict[str, Any]], width: int) -> str:
    """One line a method, over all setups: how long, how it ended."""
    overall = [r for r in rows if r["setup"] == ALL]
    headings = ["method", "cuts", "failed", "stuck", "dead ends"]
    table = [
        [r["method"], f"{r['cuts_mean']:.1f}", str(r["failures"]), str(r["stuck"]), str(r["dead_ends"])]
        for r in overall
    ]
    if all("seconds_mean" in r for r in overall):
        headings.append("seconds")
        table = [[*cells, f"{r['seconds_mean']:.1f}"] for cells, r in zip(table, overall, strict=True)]
    return _aligned("How the trials went, over all setups (cuts and seconds: mean of a trial)", headings, table, width)


def _tests(tests: list[dict[str, Any]], width: int) -> str:
    table = [
        [
            t["method"],
            "-" if t["mean_difference"] is None else f"{t['mean_difference']:+.3f}",
            "-" if t["ci95"] is None else f"{t['ci95'][0]:+.3f} to {t['ci95'][1]:+.3f}",
            _p_value(t["p_value"]),
            _p_value(t["p_corrected"]),
        ]
        for t in tests
        if t["setup"] == ALL
    ]
    if not table:
        return ""
    headings = ["method", "difference", "95 % interval", "p", "p (Holm)"]
    return _aligned(
        f"Strict IoU minus that of {AGAINST}, trial by trial, over all setups (--json has each setup)",
        headings,
        table,
        width,
    )


def _legend(width: int) -> list[str]:
    return textwrap.wrap(
        "+-: standard deviation of the mean over the runs (seeds of planning and execution with one trained model); "
        "none is given for a single run. n: test trials, each averaged over its runs; failed and stuck trials count "
        "with what they reached. Intervals: bootstrap over trials within their setup, none "
        "where a setup has a single trial. p: paired permutation test over "
        "trials, Holm: corrected for the methods and setups asked about (all setups together on their own). The data "
        "are ours, not the paper's: the numbers do not compare one to one with its Table I.",
        width,
    )


def _notes(report: dict[str, Any], width: int) -> list[str]:
    return [line for note in report.get("notes", ()) for line in textwrap.wrap(f"NOTE {note}", width)]


def _score(mean: float | None, spread: float | None) -> str:
    if mean is None:
        return "-"
    return f"{mean:.3f}" if spread is None else f"{mean:.3f} +- {spread:.3f}"


def _p_value(p: float | None) -> str:
    if p is None:
        return "-"
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _line(setup: str, n: str, cells: Sequence[str], first: int, wide: int) -> str:
    return f"{setup}{n.rjust(first - len(setup))}" + "".join(cell.rjust(wide) for cell in cells)


def _aligned(title: str, headings: Sequence[str], table: Sequence[Sequence[str]], width: int) -> str:
    """Columns as wide as they need; the names of the first to the left, numbers to the right."""
    sizes = [max(len(row[i]) for row in (headings, *table)) for i in range(len(headings))]
    gap = 3 if sum(sizes) + 3 * (len(sizes) - 1) <= width else 1

    def line(row: Sequence[str]) -> str:
        cells = [c.rjust(s) if i else c.ljust(s) for i, (c, s) in enumerate(zip(row, sizes, strict=True))]
        return (" " * gap).join(cells).rstrip()

    return "\n".join(
        [*textwrap.wrap(title, width), line(headings), "-" * (sum(sizes) + gap * (len(sizes) - 1)), *map(line, table)]
    )


def _condition(row: dict[str, Any]) -> tuple[str, str, str]:
    return row["goals"], row["world"], row["perception"]


def _unique(names: Any) -> list[Any]:
    return list(dict.fromkeys(names))
