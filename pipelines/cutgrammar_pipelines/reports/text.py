"""A report as a table of plain text, in the manner of the paper's Table I."""

import textwrap
from collections.abc import Sequence
from typing import Any

from cutgrammar.results.comparisons import AGAINST, ALL

LEAST_WIDTH = 40

IN_PLACE = "in-place"
"""The paper's goals: where they were cut."""

MEAN = "setups"
"""Heads the means over setups."""

Column = tuple[str, str, Sequence[str]]
"""Two headings, one above the other, and the cells."""


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
        rows, means, tests, wins = (
            [one for one in report[name] if _condition(one) == condition]
            for name in ("rows", "setup_means", "tests", "improvement")
        )
        parts.append("Goals {}, world {}, perception {}".format(*condition))
        parts.append(_strict(rows, means, width))
        parts.append(_beside_the_paper(rows, means, report["paper"], width) if condition[0] == IN_PLACE else "")
        parts.append(_other_scores(means, width))
        parts.append(_outcomes(rows, width))
        parts += [_tests(tests, width), _improvement(wins, width)]
    parts.append("\n".join([*_legend(report, width), *_notes(report, width)]))
    parts.append(f"digest {report['digest'][:16]} (all but times)")
    return "\n\n".join(part for part in parts if part)


def _strict(rows: list[dict[str, Any]], means: list[dict[str, Any]], width: int) -> str:
    """Methods down, setups across, then the mean over setups and that over all trials."""
    methods, setups = _unique(r["method"] for r in rows), _unique(r["setup"] for r in rows)
    cells = {(r["setup"], r["method"]): r for r in rows} | {(MEAN, r["method"]): r for r in means}
    columns = []
    for setup in [*(s for s in setups if s != ALL), MEAN, ALL]:
        n = [cells[setup, m]["trials"] for m in methods if "trials" in cells.get((setup, m), ())]
        heads = (setup, f"n {max(n)}" if n else "")
        columns.append((*heads, [_score(cells.get((setup, m)), "iou_strict") for m in methods]))
    title = f"Strict IoU (sum over the larger count; decides). {MEAN}: mean of the setups; {ALL}: mean of all trials"
    return _grid(title, "method", methods, columns, width)


def _beside_the_paper(
    rows: list[dict[str, Any]], means: list[dict[str, Any]], paper: list[dict[str, Any]], width: int
) -> str:
    """Setups down; for each of the paper's methods what was reached here and what the paper prints."""
    found = {(r["setup"], r["method"]): r for r in rows} | {(MEAN, r["method"]): r for r in means}
    printed = {(r["setup"], r["method"]): r["iou_mean"] for r in paper}
    setups = [s for s in _unique(r["setup"] for r in rows) if s != ALL]
    columns = []
    for method in _unique(r["method"] for r in paper):
        if not any((setup, method) in found for setup in setups):
            continue
        shown = [found.get((setup, method), {}) for setup in (*setups, MEAN)]
        values = [printed.get((setup, method)) for setup in setups]
        known = [value for value in values if value is not None]
        values.append(sum(known) / len(known) if len(known) == len(setups) else None)
        columns += [
            (method, "strict", [_number(one.get("iou_strict_mean")) for one in shown]),
            ("", "matched", [_number(one.get("iou_mean")) for one in shown]),
            ("", "paper", [_number(value, 2) for value in values]),
        ]
    title = "Table I: here beside the paper's printed best-matched IoU (other data, not comparable one to one)"
    return _grid(title, "setup", [*setups, MEAN], columns, width) if columns else ""


def _other_scores(means: list[dict[str, Any]], width: int) -> str:
    named = {
        "strict": "iou_strict_mean",
        "matched": "iou_mean",
        "refined": "iou_refined_mean",
        "spectral": "spectral_mean",
        "agreement": "agreement_mean",
    }
    known = {name: field for name, field in named.items() if any(one[field] is not None for one in means)}
    table = [[one["method"], *(_number(one[field]) for field in known.values())] for one in means]
    return _aligned(
        "Means of the setups (refined: strict, once rotations are refined; spectral distance: smaller is better)",
        ["method", *known],
        table,
        width,
    )


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
            _number(t["mean_difference"], sign="+"),
            _interval(t["ci95"], sign="+"),
            _p_value(t["p_value"]),
            _p_value(t["p_corrected"]),
        ]
        for t in tests
        if t["setup"] == ALL
    ]
    if not table:
        return ""
    headings = ["method", "difference", "95 % interval", "p", "p (Holm)"]
    title = f"Strict IoU minus that of {AGAINST}, trial by trial, over all setups (--json has each setup)"
    return _aligned(title, headings, table, width)


def _improvement(found: list[dict[str, Any]], width: int) -> str:
    table = [[one["over"], _number(one["probability"]), _interval(one["ci95"])] for one in found if one["setup"] == ALL]
    title = f"How probably a run of {AGAINST} scores above one of the method on the same trial, over all setups"
    return _aligned(title, ["method", "probability", "95 % interval"], table, width) if table else ""


def _legend(report: dict[str, Any], width: int) -> list[str]:
    shown = f" Shown the trial's own demonstration: {', '.join(report['shown'])}." if report["shown"] else ""
    return textwrap.wrap(
        "+-: standard deviation of the mean over the runs (seeds of planning and execution with one trained model); "
        "none is given for a single run. n: test trials, each averaged over its runs; failed and stuck trials count "
        "with what they reached. Intervals: bootstrap over trials within their setup, none "
        "where a setup has a single trial. p: paired permutation test over "
        "trials, Holm: corrected for the methods and setups asked about (all setups together on their own). The data "
        f"are ours, not the paper's: the numbers do not compare one to one with its Table I.{shown}",
        width,
    )


def _notes(report: dict[str, Any], width: int) -> list[str]:
    return [line for note in report.get("notes", ()) for line in textwrap.wrap(f"NOTE {note}", width)]


def _score(row: dict[str, Any] | None, score: str) -> str:
    if row is None or row[f"{score}_mean"] is None:
        return "-"
    mean, spread = row[f"{score}_mean"], row[f"{score}_std_runs"]
    return f"{mean:.3f}" if spread is None else f"{mean:.3f} +- {spread:.3f}"


def _number(value: float | None, digits: int = 3, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.{digits}f}"


def _interval(ends: list[float] | None, sign: str = "") -> str:
    return "-" if ends is None else " to ".join(_number(end, sign=sign) for end in ends)


def _p_value(p: float | None) -> str:
    if p is None:
        return "-"
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _grid(title: str, corner: str, names: Sequence[str], columns: Sequence[Column], width: int) -> str:
    """Names down, columns with two headings across; as many columns in a block as fit the width."""
    first = max(len(name) for name in (corner, *names))
    wide = max(len(text) for above, below, cells in columns for text in (above, below, *cells)) + 2
    across = max(1, (width - first) // wide)
    if across >= 3 and len(columns) > across:
        across -= across % 3  # columns that belong together stay together
    blocks = []
    for begin in range(0, len(columns), across):
        shown = columns[begin : begin + across]
        body = [[name, *(cells[i] for _, _, cells in shown)] for i, name in enumerate(names)]
        heads = [["", *(above for above, _, _ in shown)], [corner, *(below for _, below, _ in shown)]]
        lines = [line[0].ljust(first) + "".join(cell.rjust(wide) for cell in line[1:]) for line in (*heads, *body)]
        blocks.append("\n".join([*lines[:2], "-" * (first + wide * len(shown)), *lines[2:]]))
    return "\n\n".join(["\n".join([*textwrap.wrap(title, width), blocks[0]]), *blocks[1:]])


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
