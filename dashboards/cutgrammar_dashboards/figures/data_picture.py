"""The paper's Fig. 3 on our data: demonstrations of every setup, the initial configuration in the corner."""

import math
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from cutgrammar.demonstration import CATEGORIES, Demonstration
from cutgrammar_dashboards.figures.layout.sheet import FAINT, MARGIN, PAPER, QUIET_INK, Sheet, new_sheet, rgb
from cutgrammar_dashboards.figures.layout.spread import apart, objects_of
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import FIRST, UNCUT, Colour

WIDTH, HEIGHT, HEAD, GAP = 2.45, 2.05, 1.15, 0.12
"""Size of a tile, height of the heading, the gap between tiles [inches]."""
MIN_COLUMNS = 4
"""Tiles in a row, over which the heading has room beside the legend."""
CATEGORY_COLOURS: Mapping[str, Colour] = dict(zip(CATEGORIES, (FIRST[4], FIRST[1], FIRST[2], FIRST[3]), strict=True))


def draw_data(examples: Mapping[str, Sequence[Demonstration]], title: str) -> Figure:
    """Examples on a sheet, a column for each setup, or several if there are few setups.

    Args:
        examples: setup -> its examples, from top to bottom.
        title: heading of the sheet.
    """
    columns = math.ceil(MIN_COLUMNS / len(examples))
    rows = max(math.ceil(len(shown) / columns) for shown in examples.values())
    width = columns * len(examples) * (WIDTH + GAP) - GAP + 2.0 * MARGIN
    height = HEAD + rows * (HEIGHT + GAP) - GAP + MARGIN
    subtitle = (
        "N objects, M categories of fragments in the goal, drawn a little apart; in the corner the initial objects."
    )
    with new_sheet(width, height, title, subtitle) as sheet:
        _draw_legend(sheet, width - MARGIN, 0.36)
        for i, (setup, shown) in enumerate(examples.items()):
            left = MARGIN + i * columns * (WIDTH + GAP)
            middle = left + (columns * (WIDTH + GAP) - GAP) / 2.0
            sheet.write(middle, HEAD - 0.16, setup, fontsize=10.5, fontweight="bold", ha="center")
            for j, demonstration in enumerate(shown):
                row, column = divmod(j, columns)
                _draw_example(sheet, demonstration, left + column * (WIDTH + GAP), HEAD + row * (HEIGHT + GAP))
    return sheet.figure


def _draw_legend(sheet: Sheet, right: float, y: float) -> None:
    x = right
    for category, colour in reversed(list(CATEGORY_COLOURS.items())):
        x -= 0.30 + 0.085 * len(category)
        sheet.ax.add_patch(Rectangle((x, y - 0.07), 0.14, 0.14, facecolor=rgb(colour), edgecolor="none"))
        sheet.write(x + 0.20, y, category, fontsize=9)


def _draw_example(sheet: Sheet, demonstration: Demonstration, x: float, y: float) -> None:
    sheet.tile(x, y, WIDTH, HEIGHT)
    ids, goal = demonstration.alive(demonstration.steps), demonstration.goal
    colours = [CATEGORY_COLOURS.get(demonstration.fragments[i].category or "", UNCUT) for i in ids]
    shifts = apart(goal, objects_of(demonstration, demonstration.steps), within=0.45, between=0.35)
    bodies = [body_of_fragment(*body) for body in zip(goal, colours, shifts, strict=True)]
    sheet.place_fitted(bodies, FRONT, (x + 0.48 * WIDTH, y + 0.40 * HEIGHT), 0.86 * WIDTH, 0.64 * HEIGHT)
    left, top = x + WIDTH - 0.74, y + HEIGHT - 0.56
    sheet.ax.add_patch(Rectangle((left, top), 0.68, 0.50, facecolor=PAPER, edgecolor=FAINT, linewidth=0.8, zorder=3.5))
    start = [body_of_fragment(fragment, UNCUT) for fragment in demonstration.start]
    sheet.place_fitted(start, FRONT, (left + 0.34, top + 0.25), 0.58, 0.40, zorder=4.0)
    sheet.write(x + 0.08, y + HEIGHT - 0.25, ", ".join(demonstration.foods), fontsize=7.5)
    text = f"{len(goal)} fragments, trial {demonstration.trial}"
    sheet.write(x + 0.08, y + HEIGHT - 0.11, text, fontsize=6.5, color=QUIET_INK)
