"""A grammar drawn: every fragment type as a picture of its typical fragment, every production as an edge.

Types come by size, the largest first; those that are never cut stand together at the end. The width of an edge and the
number on it are the probability of its production. Sizes are drawn to the power 0.6, so that small fragments can still
be seen; the length beside each is the true one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar_dashboards.figures.layout.sheet import (
    FAINT,
    PORTRAIT,
    QUIET_INK,
    STYLE,
    line,
    portrait,
    put,
    scale_to_fit,
    sheet,
    words,
)
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.palette import Colour, nth_colour

if TYPE_CHECKING:  # typing fragments needs torch, which takes seconds to import; drawing does without it
    from cutgrammar.learning.typical_fragments import TypicalFragment

ROW, GAP, MARGIN, HEAD = 0.50, 0.20, 0.35, 0.85
PARENT, CHILD, LABEL = 1.05, 0.62, 0.62
"""Heights and widths on the sheet [inches]: a production, the gap after a type, the page's margin and heading; a type's
picture, a child's picture, the words beside a type."""


def type_colour(c: int) -> Colour:
    """The colour of fragment type `c`, softened for large surfaces."""
    r, g, b = (round(0.72 * part + 0.28 * 214) for part in nth_colour(c))
    return r, g, b


@dataclass(frozen=True, eq=False)
class Gallery:
    """The portraits of all types.

    Attributes:
        bodies: one a type.
        shares: the length of each on paper, relative to the longest.
    """

    bodies: tuple[Body, ...]
    shares: tuple[float, ...]

    @staticmethod
    def of(typical: Sequence["TypicalFragment"]) -> "Gallery":
        """The portraits of these typical fragments."""
        longest = max(one.length for one in typical)
        bodies = tuple(portrait(one.mesh, type_colour(c)) for c, one in enumerate(typical))
        return Gallery(bodies, tuple((one.length / longest) ** 0.6 for one in typical))

    def hang(self, ax: Axes, c: int, middle: tuple[float, float], width: float, height: float) -> None:
        """Show type `c` about `middle`, in at most `width` x `height` inches."""
        body = [self.bodies[c]]
        fit = scale_to_fit(body, PORTRAIT, width, height)
        long = scale_to_fit(body, PORTRAIT, width * self.shares[c], np.inf)
        put(ax, body, PORTRAIT, middle, min(fit, long))


def draw_grammar(grammar: Grammar, typical: Sequence["TypicalFragment"], title: str) -> Figure:
    """The grammar on a sheet.

    Args:
        grammar: to be drawn.
        typical: the typical fragment of every type.
        title: the sheet's heading.
    """
    gallery = Gallery.of(typical)
    by_size = sorted(range(grammar.k), key=lambda c: (-typical[c].mesh.volume, c))
    cut = [c for c in by_size if c in grammar.options]
    uncut = [c for c in by_size if c not in grammar.options]
    widest = max((len(p.children) for p in grammar.probabilities), default=2)
    column = PARENT + LABEL + 0.75 + widest * (CHILD + 0.12) + 0.45
    columns = _columns([(c, len(grammar.options[c]) * ROW + GAP) for c in cut], column)
    body_height = max((sum(len(grammar.options[c]) * ROW + GAP for c in one) for one in columns), default=0.0)
    width = 2.0 * MARGIN + column * len(columns) - 0.45
    a_row = max(1, int((width - 2.0 * MARGIN) // 1.25))
    tail = (0.45 + 0.85 * -(-len(uncut) // a_row)) if uncut else 0.0
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(width, HEAD + body_height + tail + MARGIN)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        words(ax, MARGIN, 0.60, _legend(grammar), color=QUIET_INK)
        for i, one in enumerate(columns):
            y = HEAD
            for c in one:
                _type(ax, grammar, gallery, typical, c, MARGIN + i * column, y)
                y += len(grammar.options[c]) * ROW + GAP
        y = HEAD + body_height
        if uncut:
            line(ax, [(MARGIN, y + 0.05), (width - MARGIN, y + 0.05)], color=FAINT)
            words(ax, MARGIN, y + 0.22, "never cut", color=QUIET_INK, fontweight="bold")
        for i, c in enumerate(uncut):
            x, top = MARGIN + 1.25 * (i % a_row), y + 0.40 + 0.85 * (i // a_row)
            gallery.hang(ax, c, (x + 0.40, top + 0.32), 0.75, 0.46)
            _told(ax, grammar, typical, c, x + 0.80, top + 0.32)
    return figure


def _legend(grammar: Grammar) -> str:
    return (
        f"{grammar.k} fragment types, each shown by its typical training fragment, {len(grammar.probabilities)} "
        "productions with their probabilities; beside each type its share of the training fragments and its length"
    )


def _columns(blocks: Sequence[tuple[int, float]], column: float) -> list[list[int]]:
    """The blocks in their order, in as many columns as make the sheet about 1.3 times as wide as high."""
    total = sum(height for _, height in blocks)
    number = max(1, round(float(np.sqrt(1.3 * total / column))))
    columns: list[list[int]] = [[]]
    done = 0.0
    for c, height in blocks:
        if columns[-1] and done + height / 2.0 > total * len(columns) / number:
            columns.append([])
        columns[-1].append(c)
        done += height
    return columns


def _type(
    ax: Axes, grammar: Grammar, gallery: Gallery, typical: Sequence["TypicalFragment"], c: int, x: float, y: float
) -> None:
    """A type with its productions, its upper left corner at (x, y)."""
    options = sorted(grammar.options[c], key=lambda option: (-grammar.probabilities[option], option))
    middle = y + len(options) * ROW / 2.0
    gallery.hang(ax, c, (x + PARENT / 2.0, middle), PARENT, min(0.72, len(options) * ROW + 0.05))
    _told(ax, grammar, typical, c, x + PARENT + 0.06, middle)
    for i, option in enumerate(options):
        _production(ax, grammar, gallery, option, x + PARENT + LABEL, middle, y + (i + 0.5) * ROW)


def _told(ax: Axes, grammar: Grammar, typical: Sequence["TypicalFragment"], c: int, x: float, y: float) -> None:
    words(ax, x, y - 0.12, f"c{c}", fontsize=9.5, fontweight="bold")
    words(ax, x, y + 0.03, f"{100 * grammar.frequencies[c]:.0f} %", fontsize=7, color=QUIET_INK)
    words(ax, x, y + 0.15, f"{1000 * typical[c].length:.0f} mm", fontsize=7, color=QUIET_INK)


def _production(
    ax: Axes, grammar: Grammar, gallery: Gallery, option: Production, x: float, start: float, y: float
) -> None:
    """An edge from (x, start) to the children in the row of height y."""
    share = grammar.probabilities[option]
    end = x + 0.62
    curve = Curve([(x, start), (x + 0.3, start), (x + 0.12, y), (end, y)], [Curve.MOVETO, *[Curve.CURVE4] * 3])
    colour = "#{:02x}{:02x}{:02x}".format(*type_colour(option.parent))
    ax.add_patch(PathPatch(curve, facecolor="none", edgecolor=colour, linewidth=0.8 + 6.0 * share, capstyle="round"))
    told = f"{share:.2f}".removeprefix("0")
    words(
        ax, end - 0.20, y, told, fontsize=7.5, ha="center", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    )
    for i, child in enumerate(option.children):
        at = end + 0.10 + CHILD / 2.0 + i * (CHILD + 0.12)
        gallery.hang(ax, child, (at, y - 0.04), CHILD, ROW - 0.14)
        words(ax, at, y + 0.19, f"c{child}", fontsize=6.5, ha="center", color=QUIET_INK)
