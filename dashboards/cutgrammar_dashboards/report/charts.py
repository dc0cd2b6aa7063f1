"""The charts of a report as inline SVG."""

from collections.abc import Collection, Iterable, Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar.results.report import DotChart, LineChart, StripChart
from cutgrammar_dashboards.rendering.palette import FIRST, Colour, nth_colour
from cutgrammar_dashboards.report.inline_svg import INK, STYLE, as_svg, hex_of

WIDTH = 10.0
"""Width of a chart as wide as the page [in]."""
LEGEND_COLUMNS = 8


def colours_of(series: Iterable[str], dashed: Collection[str] = ()) -> dict[str, Colour]:
    """A colour for each series, the same in all charts of a page.

    Those that are not dashed all differ; a dashed one may share its colour with one that is not.
    """
    names = list(dict.fromkeys(series))
    solid = [name for name in names if name not in dashed]
    rest = [name for name in names if name in dashed]
    return {name: nth_colour(k) for k, name in enumerate(solid)} | {
        name: FIRST[(len(solid) + k) % len(FIRST)] for k, name in enumerate(rest)
    }


def draw_dots(chart: DotChart, colours: Mapping[str, Colour], salt: str) -> str:
    """A chart of dots as SVG; `salt` makes its ids unique on a page."""
    series = list(dict.fromkeys(dot.series for panel in chart.panels for dot in panel.dots))
    n_lines = len(chart.lines)
    size = (0.42 * WIDTH, 3.4) if chart.is_narrow else (WIDTH, 0.75 + (0.34 if chart.has_legend else 0.21) * n_lines)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(1, len(chart.panels), sharey=True, squeeze=False)[0]
        for ax, panel in zip(panels, chart.panels, strict=True):
            if panel.reference is not None:
                ax.axvline(panel.reference, color=INK, linewidth=0.8, alpha=0.5)
            for dot in panel.dots:
                offset = 0.5 * ((series.index(dot.series) + 0.5) / len(series) - 0.5) if chart.has_legend else 0.0
                level, colour = chart.lines.index(dot.line) + offset, hex_of(colours[dot.series])
                if dot.interval is not None:
                    ax.plot(dot.interval, [level] * 2, color=colour, linewidth=2.2, alpha=0.6, solid_capstyle="butt")
                ax.plot([dot.value], [level], color=colour, marker="o", markersize=4.0)
            ax.set_title(panel.title, fontsize=10.0)
            if chart.x_range is not None:
                low, high = chart.x_range
                ax.set_xlim(low - 0.03, high + 0.04)
            if len(panels) > 1:
                ax.set_xticks([0.0, 0.5, 1.0], ["0", ".5", "1"])
            for after in range(1, len(chart.groups)):
                if chart.groups[after] != chart.groups[after - 1]:
                    ax.axhline(after - 0.5, color=INK, linewidth=0.6, alpha=0.25)
            ax.set_xlabel(chart.x_label)
        _name_lines(panels[0], chart.lines)
        for ax in panels[1:]:
            ax.tick_params(axis="y", length=0)
        if chart.has_legend:
            for name in series:
                panels[0].plot([], [], "o", color=hex_of(colours[name]), label=name)
            figure.legend(loc="outside upper left", ncols=min(len(series), LEGEND_COLUMNS))
        return as_svg(figure, chart.title, salt)


def draw_lines(chart: LineChart, colours: Mapping[str, Colour], dashed: Collection[str], salt: str) -> str:
    """Lines with their bands as SVG; `salt` makes its ids unique on a page."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(0.58 * WIDTH, 3.4), layout="constrained")
        ax = figure.subplots()
        for line in chart.lines:
            colour = hex_of(colours[line.series])
            style = (0, (4, 2)) if line.series in dashed else "solid"
            if line.band is not None:
                ax.fill_between(line.x, *line.band, color=colour, alpha=0.13, linewidth=0)
            ax.plot(line.x, line.y, color=colour, linewidth=1.6, linestyle=style, label=line.series)
        ax.set_xlim(0.0, 1.0)
        ax.set_ylim(0.0, 1.01)
        ax.grid(True, color=INK, alpha=0.12)
        ax.set_xlabel(chart.x_label)
        ax.set_ylabel(chart.y_label)
        figure.legend(loc="outside right upper", fontsize=9.0)
        return as_svg(figure, chart.title, salt)


def draw_strips(chart: StripChart, salt: str) -> str:
    """Single values, one row of dots a line, as SVG; `salt` makes its ids unique on a page."""
    groups = list(dict.fromkeys(group for by_group in chart.values.values() for group in by_group))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 0.9 + 0.75 * len(chart.values)), layout="constrained")
        ax = figure.subplots()
        ax.axvline(0.0, color=INK, linewidth=1.0, alpha=0.6)
        for row, by_group in enumerate(chart.values.values()):
            for k, group in enumerate(groups):
                values = np.asarray(by_group.get(group, ()), dtype=np.float64)
                level = row + 0.62 * ((k + 0.5) / len(groups) - 0.5) + 0.05 * np.sin(2.4 * np.arange(len(values)))
                label = None if row else group
                ax.scatter(values, level, s=16, color=hex_of(nth_colour(k)), alpha=0.75, linewidth=0, label=label)
            mean = np.concatenate([np.asarray(values, dtype=np.float64) for values in by_group.values()]).mean()
            ax.plot([mean] * 2, [row - 0.42, row + 0.42], color=INK, linewidth=2.2)
            ax.annotate(f"mean {mean:+.3f}", (1.0, row), xycoords=("axes fraction", "data"), ha="right", va="center")
        reach = max(abs(v) for by_group in chart.values.values() for values in by_group.values() for v in values)
        ax.set_xlim(-1.08 * reach - 0.01, 1.45 * reach + 0.01)
        _name_lines(ax, list(chart.values))
        ax.set_xlabel(chart.x_label)
        figure.legend(loc="outside upper left", ncols=len(groups))
        return as_svg(figure, chart.title, salt)


def _name_lines(ax: Axes, names: Sequence[str]) -> None:
    """Names down the left side, the first at the top."""
    ax.set_yticks(range(len(names)), list(names))
    ax.set_ylim(len(names) - 0.4, -0.6)
