"""The summary of ablations as one HTML page that asks nothing of the network: a chart of differences, then tables."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import matplotlib
from matplotlib.figure import Figure

from cutgrammar_dashboards.rendering.palette import nth_colour
from cutgrammar_dashboards.report.html_parts import escaped, heads, row, table, whole_page
from cutgrammar_dashboards.report.inline_svg import INK, STYLE, as_svg, hex_of


class Table(Protocol):
    """A titled table: the first `names` columns hold words, the rest numbers."""

    @property
    def title(self) -> str:
        """In a few words."""

    @property
    def note(self) -> str:
        """What a reader must know of it."""

    @property
    def headings(self) -> Sequence[str]:
        """Of the columns."""

    @property
    def rows(self) -> Sequence[Sequence[str]]:
        """Their cells."""

    @property
    def names(self) -> int:
        """Number of columns that hold words."""


def ablation_page(rows: Sequence[Mapping[str, Any]], tables: Sequence[Table], title: str) -> str:
    """The page as text; all that is not ours is escaped.

    Args:
        rows: of every variant and method, with "variant", "method", "goals", "mean_difference" and "ci95".
        tables: to be shown below the chart.
        title: the page's heading.
    """
    parts = [f"<h1>{escaped(title)}</h1>", LEAD]
    for number, goals in enumerate(dict.fromkeys(one["goals"] for one in rows)):
        compared = [one for one in rows if one["goals"] == goals and one["mean_difference"] is not None]
        if compared:
            parts.append(
                f"<figure>{difference_forest(compared, f'forest{number}')}<figcaption>Goals {escaped(goals)}: strict "
                "IoU of every variant minus that of the study's own settings, with 95 % "
                "intervals.</figcaption></figure>"
            )
    return whole_page(title, [*parts, *map(_table, tables)])


LEAD = (
    "<p>What changes when one thing is changed: settings, the training seed, the number of training trials; what each "
    "oracle adds; and how a model does on foods that it never saw. Strict IoU throughout: the sum over matched pairs, "
    "divided by the larger number of fragments. The data are ours, not the paper's.</p>"
)


def difference_forest(rows: Sequence[Mapping[str, Any]], salt: str) -> str:
    """One line a variant, one dot a method: the mean difference with its interval, as SVG.

    Args:
        rows: with "question", "variant", "method", "mean_difference" and "ci95".
        salt: makes the SVG's ids its own on a page.
    """
    lines = list(dict.fromkeys((one["question"], one["variant"]) for one in rows))
    methods = list(dict.fromkeys(one["method"] for one in rows))
    labels = [variant for _, variant in lines]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 1.0 + 0.34 * len(lines)), layout="constrained")
        ax = figure.subplots()
        ax.axvline(0.0, color=INK, linewidth=1.0, alpha=0.6)
        for k, method in enumerate(methods):
            for one in (one for one in rows if one["method"] == method):
                level = lines.index((one["question"], one["variant"])) + 0.5 * ((k + 0.5) / len(methods) - 0.5)
                if one["ci95"] is not None:
                    ax.plot(one["ci95"], [level, level], color=hex_of(nth_colour(k)), linewidth=1.6)
                ax.plot(one["mean_difference"], level, "o", color=hex_of(nth_colour(k)), markersize=5)
            ax.plot([], [], "o", color=hex_of(nth_colour(k)), label=method)
        for after in range(1, len(lines)):
            if lines[after][0] != lines[after - 1][0]:
                ax.axhline(after - 0.5, color=INK, linewidth=0.6, alpha=0.25)
        ax.set_ylim(len(lines) - 0.5, -0.5)
        ax.set_yticks(range(len(lines)), labels)
        ax.set_xlabel("difference in strict IoU (left: worse than the study's own settings)")
        figure.legend(loc="outside upper left", ncols=min(len(methods), 8))
        return as_svg(figure, "Differences in strict IoU from the study's own settings, variant by variant", salt)


def _table(shown: Table) -> str:
    words = shown.headings[: shown.names]
    body = [row(line[0], [_cell(cell, i < shown.names) for i, cell in enumerate(line) if i > 0]) for line in shown.rows]
    return f"<h2>{escaped(shown.title)}</h2>" + table("", heads(*shown.headings, words=words), body, shown.note)


def _cell(text: str, word: bool) -> str:
    """A cell; names are not broken within a word, numbers not at all."""
    if word:
        return f'<td style="text-align: left">{escaped(text)}</td>'
    return f'<td style="white-space: nowrap">{escaped(text).replace("+-", "&plusmn;")}</td>'
