"""The colours of recordings, figures and pages, so that a fragment type looks the same everywhere."""

import colorsys
from functools import lru_cache

Colour = tuple[int, int, int]
"""Red, green, blue, each 0 to 255."""

FIRST: tuple[Colour, ...] = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (213, 94, 0),
    (196, 180, 60),
    (120, 94, 210),
)
"""Distinct for most people who confuse red and green (after Okabe and Ito)."""

UNTYPED: Colour = (222, 184, 135)
"""Fragments whose type is not known."""

UNSEGMENTED: Colour = (120, 124, 130)
"""Points that are not assigned to a fragment."""

UNCUT: Colour = (214, 190, 150)
"""Initial objects in figures."""

GOAL: Colour = (120, 168, 214)
"""Goal fragments in figures that compare results with them."""

UNMATCHED: Colour = (176, 180, 186)
"""Fragments without a match in figures."""

PLANE: Colour = (255, 82, 82)
QUIET: Colour = (150, 150, 150)
GOLDEN_TURN = 0.618033988749895


@lru_cache(maxsize=1024)
def nth_colour(index: int) -> Colour:
    """The colour of fragment type (or matched pair, or method) `index`; all are different."""
    if index < len(FIRST):
        return FIRST[index]
    hue = (0.13 + index * GOLDEN_TURN) % 1.0
    value = (0.95, 0.75, 0.6)[index % 3]
    return _bytes(colorsys.hsv_to_rgb(hue, 0.62, value))


@lru_cache(maxsize=1024)
def tinted(colour: Colour, index: int) -> Colour:
    """`colour` a little lighter or darker by `index`, so that neighbours of one type differ."""
    step = (0.0, 0.22, -0.14, 0.1, -0.24)[index % 5]
    towards = 255 if step > 0 else 0
    return _bytes(tuple((c + abs(step) * (towards - c)) / 255.0 for c in colour))


@lru_cache(maxsize=1024)
def pale(colour: Colour) -> Colour:
    """`colour` close to white, for what others are to stand out from."""
    return _bytes(tuple((c + 0.68 * (255 - c)) / 255.0 for c in colour))


def graded(share: float) -> Colour:
    """The colour of an IoU: from red (0) over amber to green (1)."""
    x = min(1.0, max(0.0, share))
    return _bytes(colorsys.hsv_to_rgb(0.36 * x, 0.85, 0.9 - 0.15 * x))


def soft_graded(iou: float) -> Colour:
    """The colour of an IoU, softened for large surfaces, and spread so that medium values differ visibly."""
    return _bytes(tuple((0.78 * part + 0.22 * 225) / 255.0 for part in graded(iou**1.6)))


def _bytes(rgb: tuple[float, ...]) -> Colour:
    r, g, b = (round(255 * c) for c in rgb)
    return r, g, b
