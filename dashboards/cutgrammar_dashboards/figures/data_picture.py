"""The paper's Fig. 3 on our data: demonstrations of every setup, the initial configuration in the corner."""

from collections.abc import Mapping, Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

from cutgrammar.demonstration import CATEGORIES, Demonstration
from cutgrammar_dashboards.figures.layout.sheet import FAINT, PAPER, QUIET_INK, STYLE, put, scale_to_fit, sheet, words
from cutgrammar_dashboards.figures.layout.spread import apart, objects_of
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import FIRST, Colour

WIDE, HIGH, MARGIN, HEAD, GAP = 2.45, 2.05, 0.35, 1.15, 0.12
"""Size of a tile, the page's margin and heading, the gap between tiles [inches]."""
CATEGORY_COLOURS: Mapping[str, Colour] = dict(zip(CATEGORIES, (FIRST[4], FIRST[1], FIRST[2], FIRST[3]), strict=True))
RAW: Colour = (214, 190, 150)
"""What is not cut yet."""


def draw_data(examples: Mapping[str, Sequence[Demonstration]], title: str) -> Figure:
    """Examples on a sheet, a column for each setup.

    Args:
        examples: setup -> its examples, from top to bottom.
        title: the sheet's heading.
    """
    rows = max(len(column) for column in examples.values())
    width = 2.0 * MARGIN + len(examples) * (WIDE + GAP) - GAP
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(width, HEAD + rows * (HIGH + GAP) + MARGIN - GAP)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        told = (
            "N objects, M categories of fragments in the goal, drawn a little apart; in the corner the initial objects."
        )
        words(ax, MARGIN, 0.62, told, color=QUIET_INK)
        _legend(ax, width - MARGIN, 0.36)
        for i, (setup, column) in enumerate(examples.items()):
            x = MARGIN + i * (WIDE + GAP)
            words(ax, x + WIDE / 2.0, HEAD - 0.16, setup, fontsize=10.5, fontweight="bold", ha="center")
            for j, demonstration in enumerate(column):
                _tile(ax, demonstration, x, HEAD + j * (HIGH + GAP))
    return figure


def _legend(ax: Axes, right: float, y: float) -> None:
    x = right
    for category, colour in reversed(list(CATEGORY_COLOURS.items())):
        x -= 0.30 + 0.085 * len(category)
        shade = tuple(part / 255.0 for part in colour)
        ax.add_patch(Rectangle((x, y - 0.07), 0.14, 0.14, facecolor=shade, edgecolor="none"))
        words(ax, x + 0.20, y, category, fontsize=9)


def _tile(ax: Axes, demonstration: Demonstration, x: float, y: float) -> None:
    frame = FancyBboxPatch((x, y), WIDE, HIGH, boxstyle="round,pad=0,rounding_size=0.06", linewidth=0.8)
    frame.set(facecolor="#fafbfc", edgecolor=FAINT)
    ax.add_patch(frame)
    step = demonstration.steps
    goal = demonstration.configuration(step)
    shifts = apart(goal, objects_of(demonstration, step), within=0.45, between=0.35)
    ids = demonstration.alive(step)
    bodies = [
        body_of_fragment(fragment, CATEGORY_COLOURS.get(demonstration.fragments[i].category or "", RAW), shift)
        for fragment, i, shift in zip(goal, ids, shifts, strict=True)
    ]
    put(ax, bodies, FRONT, (x + 0.48 * WIDE, y + 0.40 * HIGH), scale_to_fit(bodies, FRONT, 0.86 * WIDE, 0.64 * HIGH))
    start = [body_of_fragment(fragment, RAW) for fragment in demonstration.start]
    corner = (x + WIDE - 0.74, y + HIGH - 0.56)
    ax.add_patch(Rectangle(corner, 0.68, 0.50, facecolor=PAPER, edgecolor=FAINT, linewidth=0.8, zorder=3.5))
    put(ax, start, FRONT, (corner[0] + 0.34, corner[1] + 0.25), scale_to_fit(start, FRONT, 0.58, 0.40), zorder=4.0)
    words(ax, x + 0.08, y + HIGH - 0.25, ", ".join(demonstration.foods), fontsize=7.5)
    words(
        ax,
        x + 0.08,
        y + HIGH - 0.11,
        f"{len(goal)} fragments, trial {demonstration.trial}",
        fontsize=6.5,
        color=QUIET_INK,
    )
