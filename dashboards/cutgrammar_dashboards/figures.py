"""Figures of a report: scores by setup and method, paired differences, and configurations drawn from their meshes.

Charts become SVG whose lines and letters take the colour of the page around them; drawings become PNG on nothing.
"""

import base64
import html
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar_dashboards.palette import QUIET, Colour, nth_colour, tinted

INK = "#0a0b0c"
"""Stands for the colour of the page's text until the SVG is written."""

STYLE: dict[str, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cutgrammar",
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.size": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor"), "none"),
    "legend.frameon": False,
}

TOWARDS_EYE = np.array([0.45, -0.75, 0.48]) / np.linalg.norm([0.45, -0.75, 0.48])
LIGHT = np.array([0.1, -0.45, 0.9]) / np.linalg.norm([0.1, -0.45, 0.9])


def score_chart(rows: Sequence[Mapping[str, Any]], salt: str) -> str:
    """Mean strict IoU of every method in every setup, with 95 % intervals, as SVG.

    Args:
        rows: the report's rows of one goals, world and perception.
        salt: makes the SVG's ids its own on a page.
    """
    setups, methods = _unique(r["setup"] for r in rows), _unique(r["method"] for r in rows)
    cells = {(r["setup"], r["method"]): r for r in rows}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 3.8), layout="constrained")
        ax = figure.subplots()
        wide = 0.82 / len(methods)
        for k, method in enumerate(methods):
            places = np.arange(len(setups)) - 0.41 + wide * (k + 0.5)
            shown = [(x, cells[s, method]) for x, s in zip(places, setups, strict=True) if (s, method) in cells]
            heights = [row["iou_strict_mean"] for _, row in shown]
            ax.bar([x for x, _ in shown], heights, 0.92 * wide, color=_hex(nth_colour(k)), label=method)
            for x, row in shown:
                if row["iou_strict_ci95"] is not None:
                    ax.plot([x, x], row["iou_strict_ci95"], color=INK, linewidth=1.2, solid_capstyle="butt")
        ax.set_xticks(range(len(setups)), setups)
        ax.set_ylim(0.0, 1.0)
        ax.set_ylabel("strict IoU")
        ax.yaxis.grid(True, color=INK, alpha=0.12)
        ax.set_axisbelow(True)
        figure.legend(loc="outside upper left", ncols=min(len(methods), 8))
        return _svg(figure, "Mean strict IoU by setup and method with 95 % intervals", salt)


def difference_chart(differences: Mapping[str, Mapping[str, Sequence[float]]], against: str, salt: str) -> str:
    """Strict IoU of every trial minus that of the method compared against, one row of dots a method, as SVG.

    Args:
        differences: method -> setup -> differences of its trials.
        against: the method compared against.
        salt: makes the SVG's ids its own on a page.
    """
    setups = _unique(setup for of_method in differences.values() for setup in of_method)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 0.9 + 0.75 * len(differences)), layout="constrained")
        ax = figure.subplots()
        ax.axvline(0.0, color=INK, linewidth=1.0, alpha=0.6)
        for row, by_setup in enumerate(differences.values()):
            for k, setup in enumerate(setups):
                values = np.asarray(by_setup.get(setup, ()), dtype=np.float64)
                level = row + 0.62 * ((k + 0.5) / len(setups) - 0.5) + 0.05 * np.sin(2.4 * np.arange(len(values)))
                colour = _hex(nth_colour(k))
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
        return _svg(figure, f"Differences in strict IoU from {against}, trial by trial", salt)


def draw_configuration(
    configuration: Configuration, ax: Axes, colours: Sequence[Colour] | None = None, apart: float = 0.0
) -> None:
    """Draw fragments as seen from the front and above, shaded, into two-dimensional axes.

    Args:
        configuration: fragments in the world frame; clouds are drawn as points.
        ax: where to draw; its axes are hidden and scaled alike.
        colours: one a fragment; all different without.
        apart: every fragment is shown farther from the middle by this share of its distance from it.
    """
    ax.set_axis_off()
    ax.set_aspect("equal")
    if not configuration:
        return
    colours = colours or [nth_colour(i) for i in range(len(configuration))]
    middle = np.mean([fragment.p_WC for fragment in configuration], axis=0)
    right = np.cross([0.0, 0.0, 1.0], TOWARDS_EYE)
    right /= np.linalg.norm(right)
    up = np.cross(TOWARDS_EYE, right)
    polygons, depths, shades = [], [], []
    for fragment, colour in zip(configuration, colours, strict=True):
        shift = apart * (fragment.p_WC - middle)
        if not isinstance(fragment.shape, Mesh):
            points = fragment.X_WF.apply(fragment.shape.points) + shift
            ax.scatter(points @ right, points @ up, s=1.5, color=_hex(colour), linewidth=0)
            continue
        corners = fragment.X_WF.apply(fragment.shape.triangles.reshape(-1, 3)).reshape(-1, 3, 3) + shift
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        seen = normals @ TOWARDS_EYE > 1e-9 * lengths
        corners, normals = corners[seen], normals[seen] / lengths[seen, None]
        polygons.append(np.stack([corners @ right, corners @ up], axis=2))
        depths.append((corners @ TOWARDS_EYE).mean(axis=1))
        lit = 0.5 + 0.5 * np.clip(normals @ LIGHT, 0.0, 1.0)
        shades.append(np.clip(lit[:, None] * np.asarray(colour) / 255.0, 0.0, 1.0))
    if polygons:
        far_first = np.argsort(np.concatenate(depths), kind="stable")
        faces = np.concatenate(shades)[far_first]
        drawn = PolyCollection(
            list(np.concatenate(polygons)[far_first]), facecolors=faces, edgecolors=faces, linewidths=0.3
        )
        ax.add_collection(drawn)
    ax.autoscale_view()


def trial_picture(
    start: Configuration, goal: Configuration, reached: Configuration, pairs: Iterable[tuple[int, int]]
) -> str:
    """Start, goal and what was reached side by side, as an <img> with PNG data.

    Fragments are drawn a little apart.

    Args:
        start, goal, reached: configurations.
        pairs: (reached, goal) indices of matched fragments, which get one colour; what was reached beside is grey.
    """
    goal_colours = [tinted(nth_colour(j % 8), j // 8) for j in range(len(goal))]
    reached_colours = [QUIET for _ in reached]
    for i, j in pairs:
        reached_colours[i] = goal_colours[j]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 2.3), layout="constrained")
        left, middle, right = figure.subplots(1, 3)
        draw_configuration(start, left, [QUIET] * len(start))
        draw_configuration(goal, middle, goal_colours, apart=0.35)
        draw_configuration(reached, right, reached_colours, apart=0.35)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=110, transparent=True, metadata={"Software": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    what = f"start, goal with {len(goal)} fragments, and the {len(reached)} fragments reached"
    return f'<img alt="{html.escape(what)}" src="data:image/png;base64,{data}">'


def _svg(figure: Figure, label: str, salt: str) -> str:
    """The figure as an inline SVG; ids are made its own, so that several can stand on one page."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": salt}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{salt}-", text)
    return text.replace("<svg", f'<svg role="img" aria-label="{html.escape(label)}"', 1)


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _unique(names: Any) -> list[Any]:
    return list(dict.fromkeys(names))
