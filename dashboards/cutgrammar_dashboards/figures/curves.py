"""Curves of a training: what induction finds for every number of types k, and how losses fall from epoch to epoch."""

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar_dashboards.figures.layout.sheet import FAINT, INK, QUIET_INK, STYLE, chart, sheet, words

MARGIN, HEAD, WIDE, HIGH, GAP = 0.35, 0.95, 3.6, 2.3, 0.95
BLUE, RED = "#0072b2", "#d55e00"
PANELS = (
    ("objective", "objective of MAP, Eq. (1)", "the mean over restarts; band: two standard deviations"),
    ("held_out", "held-out log likelihood", "of the trials left out, the mean over the folds"),
    ("productions", "productions", "the mean over restarts"),
)
"""Name in the curve, what it is, and how to read it."""


def draw_induction(curve: Sequence[Mapping[str, float | None]], chosen: int, title: str) -> Figure:
    """Induction over the number of types: objective, held-out likelihood, number of productions.

    Args:
        curve: one entry for each k, as in a model's `induction["curve"]`: "k" and "NAME_mean", maybe "NAME_std".
        chosen: the number of types chosen.
        title: the sheet's heading.
    """
    panels = [panel for panel in PANELS if any(point.get(f"{panel[0]}_mean") is not None for point in curve)]
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(2.0 * MARGIN + 0.45 + max(len(panels), 1) * (WIDE + GAP) - GAP, HEAD + HIGH + 0.75)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        words(
            ax,
            MARGIN,
            0.60,
            f"the dashed line is the number of types chosen, {chosen}; few types fall far below the charts",
            color=QUIET_INK,
        )
        for i, (name, what, how) in enumerate(panels):
            axes = chart(figure, MARGIN + 0.45 + i * (WIDE + GAP), HEAD + 0.25, WIDE, HIGH)
            axes.set_title(what, loc="left", fontsize=9.5, fontweight="bold", pad=14)
            axes.annotate(how, (0.0, 1.02), xycoords="axes fraction", fontsize=7, color=QUIET_INK, va="bottom")
            _over_k(axes, curve, name)
            axes.axvline(chosen, color=RED, linewidth=1.1, linestyle=(0, (4, 2)))
            axes.set_xlabel("number of fragment types k")
    return figure


def draw_losses(curves: Mapping[str, Sequence[tuple[int, float]]], title: str) -> Figure:
    """Losses over epochs, a panel each; a dot marks the lowest.

    Args:
        curves: what it is -> (epoch, loss) pairs.
        title: the sheet's heading.
    """
    a_row = min(3, max(len(curves), 1))
    rows = -(-len(curves) // a_row)
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(2.0 * MARGIN + 0.45 + a_row * (WIDE + GAP) - GAP, 0.5 + rows * (HIGH + GAP) + 0.2)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        for i, (name, pairs) in enumerate(curves.items()):
            x, y = MARGIN + 0.45 + i % a_row * (WIDE + GAP), 0.85 + i // a_row * (HIGH + GAP)
            axes = chart(figure, x, y, WIDE, HIGH)
            axes.set_title(name, loc="left", fontsize=9.5, fontweight="bold")
            _styled(axes)
            if not pairs:
                continue
            epochs, losses = (np.array(values, dtype=np.float64) for values in zip(*pairs, strict=True))
            axes.plot(epochs, losses, color=BLUE, linewidth=1.4)
            lowest = int(losses.argmin())
            axes.plot(epochs[lowest], losses[lowest], "o", color=RED, markersize=5)
            told = f"{losses[lowest]:.3g} after {epochs[lowest]:.0f}"
            axes.annotate(told, (0.98, 0.94), xycoords="axes fraction", ha="right", va="top")
            axes.set_xlabel("epoch")
    return figure


def _over_k(axes: Axes, curve: Sequence[Mapping[str, float | None]], name: str) -> None:
    points = [(point["k"], point.get(f"{name}_mean"), point.get(f"{name}_std") or 0.0) for point in curve]
    known = [(k, mean, std) for k, mean, std in points if k is not None and mean is not None]
    k, mean, std = (np.array(values, dtype=np.float64) for values in zip(*known, strict=True))
    _styled(axes)
    axes.fill_between(k, mean - 2.0 * std, mean + 2.0 * std, color=BLUE, alpha=0.18, linewidth=0)
    axes.plot(k, mean, color=BLUE, linewidth=1.4, marker="o", markersize=2.2)
    if name != "productions":  # the low end, far below all else, would press the rest into a line
        low = float(np.min((mean - 2.0 * std)[k >= min(6.0, k.max())]))
        high = float((mean + 2.0 * std).max())
        room = high - low or max(abs(high), 1.0)  # one value alone stands in the middle of something, too
        axes.set_ylim(low - 0.12 * room, high + 0.06 * room)


def _styled(axes: Axes) -> None:
    axes.grid(True, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=7.5, length=2.5)
    axes.spines[["left", "bottom"]].set_color(INK)
