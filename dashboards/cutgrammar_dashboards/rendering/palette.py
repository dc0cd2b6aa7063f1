"""One set of colours for recordings and pages, so that a fragment type looks the same everywhere."""

import colorsys

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
"""Told apart by most people whose eyes confuse red and green (after Okabe and Ito)."""

UNTYPED: Colour = (222, 184, 135)
"""Fragments of which no type is known."""

UNSEGMENTED: Colour = (120, 124, 130)
"""Points of which it is not known what they belong to."""

PLANE: Colour = (255, 82, 82)
QUIET: Colour = (150, 150, 150)
GOLDEN_TURN = 0.618033988749895


def nth_colour(index: int) -> Colour:
    """The colour of fragment type (or matched pair, or method) `index`; as many as are needed, all different."""
    if index < len(FIRST):
        return FIRST[index]
    hue = (0.13 + index * GOLDEN_TURN) % 1.0
    value = (0.95, 0.75, 0.6)[index % 3]
    return _bytes(colorsys.hsv_to_rgb(hue, 0.62, value))


def tinted(colour: Colour, index: int) -> Colour:
    """`colour` a little lighter or darker by `index`, so that neighbours of one type can be told apart."""
    step = (0.0, 0.22, -0.14, 0.1, -0.24)[index % 5]
    towards = 255 if step > 0 else 0
    return _bytes(tuple((c + abs(step) * (towards - c)) / 255.0 for c in colour))


def graded(share: float) -> Colour:
    """From red (0) over amber to green (1), for an IoU."""
    x = min(1.0, max(0.0, share))
    return _bytes(colorsys.hsv_to_rgb(0.36 * x, 0.85, 0.9 - 0.15 * x))


def _bytes(rgb: tuple[float, ...]) -> Colour:
    r, g, b = (round(255 * c) for c in rgb)
    return r, g, b
