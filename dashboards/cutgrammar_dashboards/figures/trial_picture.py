"""Start, goal and results of a trial side by side, as an image with a transparent ground for a page of any colour."""

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
QUALITY = 82
"""Of the WebP image; a third of the bytes of a PNG image."""
SPREAD = 0.35
"""Fragments of the goal and the result are drawn farther from the middle by this share of their distance from it."""


def trial_picture(
    start: Configuration,
    goal: Configuration,
    results: Sequence[tuple[Configuration, Sequence[tuple[int, int, float]]]],
) -> str:
    """An <img> element with WebP data; fragments are drawn a little apart.

    Args:
        start, goal: configurations.
        results: each with the (reached, goal, IoU) of its matched fragments, which share a colour; fragments without a
            match are grey.
    """
    goal_colours, reached_colours = pair_colours(len(goal), [(len(reached), pairs) for reached, pairs in results])
    columns = [(start, [QUIET] * len(start), 0.0), (goal, goal_colours, SPREAD)]
    columns += [(reached, colours, SPREAD) for (reached, _), colours in zip(results, reached_colours, strict=True)]
    image = Image.new("RGBA", (len(columns) * (WIDTH + GAP) - GAP, HEIGHT))
    for column, (configuration, colours, spread) in enumerate(columns):
        if configuration:
            drawn = draw_configuration(configuration, colours, spread)
            left = column * (WIDTH + GAP) + (WIDTH - drawn.width) // 2
            image.paste(drawn, (left, (HEIGHT - drawn.height) // 2))
    buffer = io.BytesIO()
    image.save(buffer, format="webp", quality=QUALITY, method=4)
    data = base64.b64encode(buffer.getvalue()).decode()
    counts = " and the ".join(f"{len(reached)} fragments reached" for reached, _ in results)
    alt = f"start, goal with {len(goal)} fragments, and the {counts}"
    return f'<img alt="{html.escape(alt)}" src="data:image/webp;base64,{data}">'


def pair_colours(
    n_goal: int, results: Iterable[tuple[int, Sequence[tuple[int, int, float]]]]
) -> tuple[list[Colour], list[list[Colour]]]:
    """Colours of the goal's fragments and of those of each result; a matched pair shares one, the others are grey.

    Args:
        n_goal: number of goal fragments.
        results: for each, its number of fragments and the (reached, goal, IoU) of its pairs.
    """
    goal_colours, all_reached = [QUIET] * n_goal, []
    for n_reached, pairs in results:
        reached_colours = [QUIET] * n_reached
        for i, j, _ in pairs:
            goal_colours[j] = reached_colours[i] = tinted(nth_colour(j % 8), j // 8)
        all_reached.append(reached_colours)
    return goal_colours, all_reached


def draw_configuration(configuration: Configuration, colours: Sequence[Colour], spread: float) -> Image.Image:
    """A configuration, as large as fits into `WIDTH` and `HEIGHT`, its fragments moved apart by `spread`."""
    bodies = bodies_apart(configuration, colours, spread)
    margin = 2.0 * MARGIN + 1.0
    return Image.fromarray(draw(bodies, FRONT, scale_to_fit(bodies, FRONT, WIDTH - margin, HEIGHT - margin)).pixels)
