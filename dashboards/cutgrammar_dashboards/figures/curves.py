"""Curves of a training: the results of induction for every number of types k, and losses over epochs."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar_dashboards.figures.layout.sheet import FAINT, INK, MARGIN, QUIET_INK, Sheet, new_sheet

HEAD, WIDTH, HEIGHT, GAP, LEFT = 0.95, 3.6, 2.3, 0.95, 0.45
"""Height of the heading, size of a chart, gap between charts, width of the labels at the left of a chart [inches]."""
BLUE, RED = "#0072b2", "#d55e00"
MIN_SHOWN_K = 6
"""Values for smaller k do not count for the limits of an axis: they are so low that they would flatten the curve."""
PANELS = (
    ("objective", "objective of MAP, Eq. (1)", "the mean over restarts; band: two standard deviations"),
    ("held_out", "held-out log likelihood", "of the trials left out, the mean over the folds"),
    ("productions", "productions", "the mean over restarts"),
)
"""Name in the curve, title and explanation of a chart."""

Curve = Sequence[Mapping[str, float | None]]


def draw_induction(curve: Curve, chosen: int, title: str) -> Figure:
    """Induction over the number of types: objective, held-out likelihood, number of productions.

    Args:
        curve: one entry for each k, as in a model's `induction["curve"]`: "k", "NAME_mean" and perhaps "NAME_std".
        chosen: the number of types chosen.
        title: heading of the sheet.
    """
    panels = [panel for panel in PANELS if any(point.get(f"{panel[0]}_mean") is not None for point in curve)]
    subtitle = f"the dashed line is the number of types chosen, {chosen}; values for few types are below the charts"
    with new_sheet(_width(len(panels)), HEAD + HEIGHT + 0.75, title, subtitle) as sheet:
        for i, (name, heading, explanation) in enumerate(panels):
            axes = _add_chart(sheet, i, HEAD + 0.25, heading, pad=14)
            axes.annotate(explanation, (0.0, 1.02), xycoords="axes fraction", fontsize=7, color=QUIET_INK, va="bottom")
            _draw_over_k(axes, curve, name)
            axes.axvline(chosen, color=RED, linewidth=1.1, linestyle=(0, (4, 2)))
            axes.set_xlabel("number of fragment types k")
    return sheet.figure


def draw_losses(curves: Mapping[str, Sequence[tuple[int, float]]], title: str) -> Figure:
    """Losses over epochs, a chart each; a dot marks the lowest.

    Args:
        curves: name -> (epoch, loss) pairs.
        title: heading of the sheet.
    """
    per_row = min(3, max(len(curves), 1))
    rows = -(-len(curves) // per_row)
    with new_sheet(_width(per_row), 0.5 + rows * (HEIGHT + GAP) + 0.2, title) as sheet:
        for i, (name, pairs) in enumerate(curves.items()):
            axes = _add_chart(sheet, i % per_row, 0.85 + i // per_row * (HEIGHT + GAP), name)
            if not pairs:
                continue
            epochs, losses = (np.array(values, dtype=np.float64) for values in zip(*pairs, strict=True))
            axes.plot(epochs, losses, color=BLUE, linewidth=1.4)
            lowest = int(losses.argmin())
            axes.plot(epochs[lowest], losses[lowest], "o", color=RED, markersize=5)
            text = f"{losses[lowest]:.3g} after {epochs[lowest]:.0f}"
            axes.annotate(text, (0.98, 0.94), xycoords="axes fraction", ha="right", va="top")
            axes.set_xlabel("epoch")
    return sheet.figure


def _width(n_charts: int) -> float:
    return 2.0 * MARGIN + LEFT + max(n_charts, 1) * (WIDTH + GAP) - GAP


def _add_chart(sheet: Sheet, column: int, y: float, title: str, pad: float | None = None) -> Axes:
    axes = sheet.chart(MARGIN + LEFT + column * (WIDTH + GAP), y, WIDTH, HEIGHT)
    axes.set_title(title, loc="left", fontsize=9.5, fontweight="bold", pad=pad)
    axes.grid(True, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=7.5, length=2.5)
    axes.spines[["left", "bottom"]].set_color(INK)
    return axes


def _draw_over_k(axes: Axes, curve: Curve, name: str) -> None:
    points = [(point["k"], point.get(f"{name}_mean"), point.get(f"{name}_std") or 0.0) for point in curve]
    known = [point for point in points if None not in point]
    k, mean, std = (np.array(values, dtype=np.float64) for values in zip(*known, strict=True))
    axes.fill_between(k, mean - 2.0 * std, mean + 2.0 * std, color=BLUE, alpha=0.18, linewidth=0)
    axes.plot(k, mean, color=BLUE, linewidth=1.4, marker="o", markersize=2.2)
    if name != "productions":
        low = float(np.min((mean - 2.0 * std)[k >= min(MIN_SHOWN_K, k.max())]))
        high = float((mean + 2.0 * std).max())
        range_ = high - low or max(abs(high), 1.0)  # a single value is shown in the middle of some range, too
        axes.set_ylim(low - 0.12 * range_, high + 0.06 * range_)
