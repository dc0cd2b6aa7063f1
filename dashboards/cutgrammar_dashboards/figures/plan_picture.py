"""Pictures of a plan: one of every step, with the cutting plane and what comes of it, and one of the whole plan."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar_dashboards.figures.layout.sheet import MARGIN, QUIET_INK, Sheet, new_sheet, rgb, scale_to_fit
from cutgrammar_dashboards.figures.layout.spread import bodies_apart
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import FIRST, PLANE, UNCUT, Colour, nth_colour, tinted
from cutgrammar_dashboards.rendering.placement import quad

WIDTH, HEIGHT, HEAD, FOOT = 3.9, 2.9, 0.85, 0.3
"""Size of a configuration's space, heights of the heading and of the line below [inches]."""
SPREAD = 0.35
"""Fragments after a cut are drawn farther from the middle by this share of their distance from it."""
TARGET: Colour = FIRST[1]
PRODUCTS: tuple[Colour, Colour] = (FIRST[1], FIRST[4])
COLUMNS = 5
"""Steps in a row of the whole plan."""


@dataclass(frozen=True, eq=False)
class PlanStep:
    """One cut of a plan.

    Attributes:
        title: e.g. "Cut 1 of 3: whole.stl".
        before, after: the configurations around it.
        targets: indices in `before` of the fragments to cut.
        plane_W: the cutting plane.
    """

    title: str
    before: Configuration
    after: Configuration
    targets: tuple[int, ...]
    plane_W: Plane


def draw_step(step: PlanStep, subtitle: str) -> Figure:
    """One step: the fragments with the cutting plane, and those after the cut, drawn a little apart."""
    with new_sheet(2.0 * WIDTH + 2.0 * MARGIN + 0.5, HEAD + HEIGHT + FOOT, step.title, subtitle) as sheet:
        y = HEAD + HEIGHT / 2.0
        _draw_before(sheet, step, (MARGIN + WIDTH / 2.0, y), WIDTH, HEIGHT)
        sheet.arrow(MARGIN + WIDTH + 0.05, MARGIN + WIDTH + 0.45, y)
        fresh = [i for i, fragment in enumerate(step.after) if not any(fragment is old for old in step.before)]
        colours = [PRODUCTS[fresh.index(i) % 2] if i in fresh else UNCUT for i in range(len(step.after))]
        _draw_apart(sheet, step.after, colours, (MARGIN + 1.5 * WIDTH + 0.5, y), WIDTH, HEIGHT)
        line = HEAD + HEIGHT + 0.1
        sheet.write(MARGIN + WIDTH / 2.0, line, f"before the cut: {len(step.before)}", ha="center", color=QUIET_INK)
        text = f"after it: {len(step.after)}, drawn a little apart"
        sheet.write(MARGIN + 1.5 * WIDTH + 0.5, line, text, ha="center", color=QUIET_INK)
    return sheet.figure


def draw_plan(
    steps: Sequence[PlanStep],
    goal: Configuration,
    reached: Configuration,
    pairs: Sequence[tuple[int, int]],
    title: str,
    subtitle: str,
) -> Figure:
    """The whole plan on one sheet: every step, then what is reached and the goal, matched fragments in one colour.

    Args:
        steps: in their order.
        goal: the goal's fragments.
        reached: the fragments after the last step.
        pairs: (reached, goal) indices of matched fragments.
        title, subtitle: heading of the sheet.
    """
    width, height = 0.62 * WIDTH, 0.62 * HEIGHT
    goal_colours = [tinted(nth_colour(j % 8), j // 8) for j in range(len(goal))]
    colours: list[Colour] = [UNCUT for _ in reached]
    for i, j in pairs:
        colours[i] = goal_colours[j]
    count = len(steps) + 2
    columns, rows = min(COLUMNS, count), -(-count // COLUMNS)
    with new_sheet(columns * width + 2.0 * MARGIN, HEAD + rows * (height + FOOT) + 0.1, title, subtitle) as sheet:
        for k in range(count):
            x = MARGIN + (k % COLUMNS + 0.5) * width
            y = HEAD + (k // COLUMNS) * (height + FOOT) + height / 2.0
            if k < len(steps):
                _draw_before(sheet, steps[k], (x, y), 0.9 * width, 0.9 * height)
                text = steps[k].title
            elif k == len(steps):
                _draw_apart(sheet, reached, colours, (x, y), 0.9 * width, 0.9 * height)
                text = "Reached, drawn a little apart"
            else:
                _draw_apart(sheet, goal, goal_colours, (x, y), 0.9 * width, 0.9 * height)
                text = "Goal"
            sheet.write(x, y + height / 2.0 + 0.1, text, ha="center", fontsize=8)
    return sheet.figure


def _draw_before(sheet: Sheet, step: PlanStep, middle: tuple[float, float], width: float, height: float) -> None:
    bodies = [
        body_of_fragment(fragment, TARGET if i in step.targets else UNCUT) for i, fragment in enumerate(step.before)
    ]
    scale = scale_to_fit(bodies, FRONT, 0.9 * width, 0.9 * height)
    locate = sheet.place(bodies, FRONT, middle, scale)
    corners = locate(quad(step.plane_W, [step.before[i] for i in step.targets]))
    spread = np.clip(corners - middle, [-width / 2.0, -height / 2.0], [width / 2.0, height / 2.0])
    sheet.ax.add_patch(
        Polygon(
            spread + middle, closed=True, facecolor=(*rgb(PLANE), 0.30), edgecolor=rgb(PLANE), linewidth=1.2, zorder=5
        )
    )


def _draw_apart(
    sheet: Sheet,
    configuration: Configuration,
    colours: Sequence[Colour],
    middle: tuple[float, float],
    width: float,
    height: float,
) -> None:
    if configuration:
        sheet.place_fitted(bodies_apart(configuration, colours, SPREAD), FRONT, middle, 0.9 * width, 0.9 * height)
