"""Charts of a report: scores setup by setup, the chance to be better, performance profiles, paired differences."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar_dashboards.rendering.palette import FIRST, Colour, nth_colour
from cutgrammar_dashboards.report.inline_svg import INK, STYLE, as_svg, hex_of

WIDTH = 10.0
"""Of a chart as wide as the page [in]."""


def colours_of(methods: Iterable[str], dashed: Collection[str] = ()) -> dict[str, Colour]:
    """A colour for each method, the same in all charts of a page; `dashed` ones may share theirs with one that is not.

    Those that are not dashed all differ; the dashed go on through the colours that are told apart best.
    """
    names = list(dict.fromkeys(methods))
    solid = [name for name in names if name not in dashed]
    rest = [name for name in names if name in dashed]
    return {name: nth_colour(k) for k, name in enumerate(solid)} | {
        name: FIRST[(len(solid) + k) % len(FIRST)] for k, name in enumerate(rest)
    }


def score_chart(rows: Sequence[Mapping[str, Any]], colours: Mapping[str, Colour], against: str, salt: str) -> str:
    """Mean strict IoU with 95 % intervals as SVG: a panel for every setup, a line for every method.

    Args:
        rows: the report's rows of one goals, world and perception.
        colours: of the methods.
        against: the reference method; a line in each panel shows where it stands.
        salt: makes the SVG's ids its own on a page.
    """
    setups = list(dict.fromkeys(r["setup"] for r in rows))
    methods = list(dict.fromkeys(r["method"] for r in rows))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 0.75 + 0.21 * len(methods)), layout="constrained")
        panels = figure.subplots(1, len(setups), sharey=True, squeeze=False)[0]
        for ax, setup in zip(panels, setups, strict=True):
            found = {r["method"]: r for r in rows if r["setup"] == setup}
            if against in found:
                ax.axvline(found[against]["iou_strict_mean"], color=INK, linewidth=0.8, alpha=0.35)
            for level, method in enumerate(methods):
                if method in found:
                    row = found[method]
                    _dot(ax, level, row["iou_strict_mean"], row["iou_strict_ci95"], colours[method])
            ax.set_title(setup, fontsize=10.0, fontweight="bold" if setup == "all" else "normal")
            ax.set_xlim(-0.03, 1.04)
            ax.set_xticks([0.0, 0.5, 1.0], ["0", ".5", "1"])
        _rows_of(panels[0], methods)
        for ax in panels[1:]:
            ax.tick_params(axis="y", length=0)
        return as_svg(figure, "Mean strict IoU by setup and method with 95 % intervals", salt)


def improvement_chart(found: Sequence[Mapping[str, Any]], colours: Mapping[str, Colour], salt: str) -> str:
    """How probably the reference method scores above each other one, with 95 % intervals, as SVG.

    Args:
        found: the report's probabilities over all setups, of one goals, world and perception.
        colours: of the methods.
        salt: makes the SVG's ids its own on a page.
    """
    known = [one for one in found if one["probability"] is not None]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(0.42 * WIDTH, 3.4), layout="constrained")
        ax = figure.subplots()
        ax.axvline(0.5, color=INK, linewidth=1.0, alpha=0.6)
        for level, one in enumerate(known):
            _dot(ax, level, one["probability"], one["ci95"], colours[one["over"]])
        ax.set_xlim(-0.02, 1.02)
        ax.set_xlabel(f"P({found[0]['method']} scores above it)")
        _rows_of(ax, [one["over"] for one in known])
        return as_svg(figure, f"How probably {found[0]['method']} scores above each other method", salt)


def profile_chart(
    profiles: Sequence[Mapping[str, Any]], colours: Mapping[str, Colour], dashed: Collection[str], salt: str
) -> str:
    """The share of runs that score above a threshold, over all thresholds, with 95 % bands, as SVG.

    Args:
        profiles: the report's, of one goals, world and perception.
        colours: of the methods.
        dashed: methods whose lines are dashed.
        salt: makes the SVG's ids its own on a page.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(0.58 * WIDTH, 3.4), layout="constrained")
        ax = figure.subplots()
        for one in profiles:
            colour = hex_of(colours[one["method"]])
            style = (0, (4, 2)) if one["method"] in dashed else "solid"
            if one["ci95"] is not None:
                ax.fill_between(one["thresholds"], *one["ci95"], color=colour, alpha=0.13, linewidth=0)
            ax.plot(one["thresholds"], one["share"], color=colour, linewidth=1.6, linestyle=style, label=one["method"])
        ax.set_xlim(0.0, 1.0)
        ax.set_ylim(0.0, 1.01)
        ax.grid(True, color=INK, alpha=0.12)
        ax.set_xlabel("strict IoU")
        ax.set_ylabel("share of runs above it")
        figure.legend(loc="outside right upper", fontsize=9.0)
        return as_svg(figure, "Share of runs above every strict IoU, method by method", salt)


def _dot(ax: Axes, level: float, value: float, interval: Sequence[float] | None, colour: Colour) -> None:
    """A value and its interval on one line."""
    if interval is not None:
        ax.plot(interval, [level, level], color=hex_of(colour), linewidth=2.2, alpha=0.6, solid_capstyle="butt")
    ax.plot([value], [level], color=hex_of(colour), marker="o", markersize=4.0)


def _rows_of(ax: Axes, names: Sequence[str]) -> None:
    """Names down the left side, the first on top."""
    ax.set_yticks(range(len(names)), list(names))
    ax.set_ylim(len(names) - 0.4, -0.6)


def difference_chart(differences: Mapping[str, Mapping[str, Sequence[float]]], against: str, salt: str) -> str:
    """Strict IoU of every trial minus that of the method compared against, one row of dots a method, as SVG.

    Args:
        differences: method -> setup -> differences of its trials.
        against: the method compared against.
        salt: makes the SVG's ids its own on a page.
    """
    setups = dict.fromkeys(setup for of_method in differences.values() for setup in of_method)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 0.9 + 0.75 * len(differences)), layout="constrained")
        ax = figure.subplots()
        ax.axvline(0.0, color=INK, linewidth=1.0, alpha=0.6)
        for row, by_setup in enumerate(differences.values()):
            for k, setup in enumerate(setups):
                values = np.asarray(by_setup.get(setup, ()), dtype=np.float64)
                level = row + 0.62 * ((k + 0.5) / len(setups) - 0.5) + 0.05 * np.sin(2.4 * np.arange(len(values)))
                colour = hex_of(nth_colour(k))
                ax.scatter(values, level, s=16, color=colour, alpha=0.75, linewidth=0, label=setup if not row else None)
            everything = np.concatenate([np.asarray(v, dtype=np.float64) for v in by_setup.values()])
            ax.plot([everything.mean()] * 2, [row - 0.42, row + 0.42], color=INK, linewidth=2.2)
            ax.annotate(
                f"mean {everything.mean():+.3f}",
                (1.0, row),
                xycoords=("axes fraction", "data"),
                ha="right",
                va="center",
            )
        reach = max((abs(v) for by in differences.values() for vs in by.values() for v in vs), default=1.0)
        ax.set_xlim(-1.08 * reach - 0.01, 1.45 * reach + 0.01)
        ax.set_ylim(len(differences) - 0.45, -0.55)
        ax.set_yticks(range(len(differences)), list(differences))
        ax.set_xlabel(f"strict IoU minus that of {against}, trial by trial (left: {against} is better)")
        figure.legend(loc="outside upper left", ncols=len(setups))
        return as_svg(figure, f"Differences in strict IoU from {against}, trial by trial", salt)
