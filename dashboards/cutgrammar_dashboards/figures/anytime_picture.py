"""Anytime curves: the score that a method reaches with a budget, a panel for each group of trials."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar_dashboards.figures.layout.sheet import FAINT, INK, MARGIN, QUIET_INK, Sheet, new_sheet
from cutgrammar_dashboards.rendering.palette import nth_colour

HEAD, WIDTH, HEIGHT, GAP_X, GAP_Y, LEFT = 1.15, 2.9, 2.0, 0.5, 0.62, 0.5
"""Height of the heading, size of a panel, gaps between panels, width of the labels at their left [inches]."""
SHIFT = 0.012
"""Each curve is shifted from the one before by this share of the axis, so that their intervals stay apart."""


@dataclass(frozen=True)
class AnytimeCurve:
    """One curve; all tuples have the same length.

    Attributes:
        name: of the curve, the same in all panels.
        budgets: ascending, greater than 0.
        scores: mean score with each budget.
        intervals: ends of the interval of each mean, None where it is not known.
    """

    name: str
    budgets: tuple[float, ...]
    scores: tuple[float, ...]
    intervals: tuple[tuple[float, float] | None, ...]


@dataclass(frozen=True)
class AnytimePanel:
    """The curves of one group of trials; `note` says how many trials they are."""

    title: str
    note: str
    curves: tuple[AnytimeCurve, ...]


def draw_anytime(
    panels: Sequence[Sequence[AnytimePanel]], title: str, subtitle: str, x_label: str, y_label: str
) -> Figure:
    """Rows of panels that share both axes; the budget is on a logarithmic axis.

    Args:
        panels: in rows from the top, each from the left; a panel without curves stays empty.
        title, subtitle: heading of the sheet.
        x_label, y_label: of the axes.
    """
    n_columns = max(map(len, panels))
    names = list(dict.fromkeys(curve.name for row in panels for panel in row for curve in panel.curves))
    curves = [curve for row in panels for panel in row for curve in panel.curves]
    ends = [end for curve in curves for interval in curve.intervals if interval for end in interval]
    scores = [*ends, *(score for curve in curves for score in curve.scores)]
    low, high = (min(scores), max(scores)) if scores else (0.0, 1.0)
    width = 2.0 * MARGIN + LEFT + n_columns * (WIDTH + GAP_X) - GAP_X
    height = HEAD + len(panels) * (HEIGHT + GAP_Y) + 0.35
    with new_sheet(width, height, title, subtitle) as sheet:
        _name_curves(sheet, names)
        for r, row in enumerate(panels):
            for c, panel in enumerate(row):
                x, y = MARGIN + LEFT + c * (WIDTH + GAP_X), HEAD + 0.2 + r * (HEIGHT + GAP_Y)
                axes = sheet.chart(x, y, WIDTH, HEIGHT)
                _draw_panel(axes, panel, names)
                axes.set_ylim(max(0.0, low - 0.03), min(1.0, high + 0.03))
                if r == len(panels) - 1:
                    axes.set_xlabel(x_label)
                if c == 0:
                    axes.set_ylabel(y_label)
    return sheet.figure


def _name_curves(sheet: Sheet, names: Sequence[str]) -> None:
    x = MARGIN + LEFT
    for name in names:
        sheet.line([(x, HEAD - 0.18), (x + 0.25, HEAD - 0.18)], color=_colour(names, name), linewidth=2.0)
        sheet.write(x + 0.32, HEAD - 0.18, name)
        x += 0.6 + 0.075 * len(name)


def _draw_panel(axes: Axes, panel: AnytimePanel, names: Sequence[str]) -> None:
    axes.set_title(panel.title, loc="left", fontsize=9.0, fontweight="bold")
    axes.annotate(panel.note, (1.0, 1.02), xycoords="axes fraction", ha="right", va="bottom", color=QUIET_INK)
    axes.set_xscale("log")
    axes.grid(True, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=7.5, length=2.5)
    axes.spines[["left", "bottom"]].set_color(INK)
    budgets = sorted({budget for curve in panel.curves for budget in curve.budgets})
    axes.set_xticks(budgets, [f"{budget:,.0f}" for budget in budgets])
    axes.minorticks_off()
    span = np.log10(max(budgets) / min(budgets)) if budgets else 0.0
    for curve in panel.curves:
        colour, order = _colour(names, curve.name), names.index(curve.name) - (len(names) - 1) / 2
        x = np.array(curve.budgets) * 10.0 ** (SHIFT * order * (span or 1.0))
        axes.plot(x, curve.scores, color=colour, linewidth=1.5, marker="o", markersize=3.5)
        for at, interval in zip(x, curve.intervals, strict=True):
            if interval is not None:
                axes.plot([at, at], interval, color=colour, linewidth=1.3, alpha=0.55, solid_capstyle="butt")


def _colour(names: Sequence[str], name: str) -> tuple[float, ...]:
    return tuple(channel / 255.0 for channel in nth_colour(names.index(name)))
