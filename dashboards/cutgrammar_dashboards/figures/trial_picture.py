"""Start, goal and result of a trial side by side, as an image with a transparent ground for a page of any colour."""

import base64
import html
import io
from collections.abc import Iterable, Sequence

from PIL import Image

from cutgrammar.geometry.fragment import Configuration
from cutgrammar_dashboards.figures.layout.sheet import scale_to_fit
from cutgrammar_dashboards.figures.layout.spread import bodies_apart
from cutgrammar_dashboards.rendering.drawing import FRONT, MARGIN, draw
from cutgrammar_dashboards.rendering.palette import QUIET, Colour, nth_colour, tinted

WIDTH, HEIGHT, GAP = 340, 240, 16
"""Size of one configuration, and the gap between two [pixels]."""
SPREAD = 0.35
"""Fragments of the goal and the result are drawn farther from the middle by this share of their distance from it."""


def trial_picture(
    start: Configuration, goal: Configuration, reached: Configuration, pairs: Iterable[tuple[int, int]]
) -> str:
    """An <img> element with PNG data; fragments are drawn a little apart.

    Args:
        start, goal, reached: configurations.
        pairs: (reached, goal) indices of matched fragments, which share a colour; unmatched results are grey.
    """
    goal_colours = [tinted(nth_colour(j % 8), j // 8) for j in range(len(goal))]
    reached_colours = [QUIET for _ in reached]
    for i, j in pairs:
        reached_colours[i] = goal_colours[j]
    image = Image.new("RGBA", (3 * WIDTH + 2 * GAP, HEIGHT))
    for column, (configuration, colours, spread) in enumerate(
        ((start, [QUIET] * len(start), 0.0), (goal, goal_colours, SPREAD), (reached, reached_colours, SPREAD))
    ):
        if configuration:
            drawn = draw_configuration(configuration, colours, spread)
            left = column * (WIDTH + GAP) + (WIDTH - drawn.width) // 2
            image.paste(drawn, (left, (HEIGHT - drawn.height) // 2))
    buffer = io.BytesIO()
    image.save(buffer, format="png")
    data = base64.b64encode(buffer.getvalue()).decode()
    alt = f"start, goal with {len(goal)} fragments, and the {len(reached)} fragments reached"
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">'


def draw_configuration(configuration: Configuration, colours: Sequence[Colour], spread: float) -> Image.Image:
    """A configuration, as large as fits into `WIDTH` and `HEIGHT`, its fragments moved apart by `spread`."""
    bodies = bodies_apart(configuration, colours, spread)
    margin = 2.0 * MARGIN + 1.0
    return Image.fromarray(draw(bodies, FRONT, scale_to_fit(bodies, FRONT, WIDTH - margin, HEIGHT - margin)).pixels)
