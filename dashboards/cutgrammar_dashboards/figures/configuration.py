"""Configurations drawn from their meshes, as PNG on nothing, for a page of any colour."""

import base64
import html
import io
from collections.abc import Iterable, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar_dashboards.rendering.palette import QUIET, Colour, nth_colour, tinted
from cutgrammar_dashboards.report.inline_svg import STYLE, hex_of

TOWARDS_EYE = np.array([0.45, -0.75, 0.48]) / np.linalg.norm([0.45, -0.75, 0.48])
LIGHT = np.array([0.1, -0.45, 0.9]) / np.linalg.norm([0.1, -0.45, 0.9])


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
            ax.scatter(points @ right, points @ up, s=1.5, color=hex_of(colour), linewidth=0)
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
