"""Example pictures: what foods look like that were cut into a category."""

import io

from cutgrammar.demonstration import Demonstration
from cutgrammar_dashboards.figures.trial_picture import draw_configuration
from cutgrammar_dashboards.rendering.food_colours import NEUTRAL, SKIN_AND_FLESH
from cutgrammar_dashboards.rendering.palette import tinted

SPREAD = 0.5
"""Fragments are drawn farther from the middle by this share of their distance from it."""


def example_picture(demonstration: Demonstration) -> bytes:
    """The goal of a demonstration as PNG, on a transparent ground, its fragments a little apart."""
    skin = SKIN_AND_FLESH.get(demonstration.foods[0], NEUTRAL)[0]
    red, green, blue = (round(255 * part) for part in skin)
    colours = [tinted((red, green, blue), i) for i in range(len(demonstration.goal))]
    buffer = io.BytesIO()
    draw_configuration(demonstration.goal, colours, SPREAD).save(buffer, format="png")
    return buffer.getvalue()
