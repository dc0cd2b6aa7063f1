"""A grammar drawn: every fragment type as its typical fragment, every production as an edge.

Types come by size, the largest first; those that are never cut are together at the end. The width of an edge and the
number on it are the probability of its production. Small fragments are enlarged so that they can be seen; the length
beside each type is the true one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar_dashboards.figures.layout.sheet import (
    FAINT,
    MARGIN,
    PORTRAIT,
    QUIET_INK,
    Sheet,
    new_sheet,
    portrait,
    rgb,
    scale_to_fit,
)
from cutgrammar_dashboards.figures.layout.tree_picture import SIZE_EXPONENT
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.palette import Colour, nth_colour

if TYPE_CHECKING:  # this module imports torch, which takes seconds and is not needed for drawing
    from cutgrammar.learning.typical_fragments import TypicalFragment

HEAD, ROW, GAP = 0.85, 0.50, 0.20
PARENT, LABEL, BRANCH, CHILD, SPACE = 1.05, 0.62, 0.62, 0.62, 0.12
UNCUT_WIDTH, UNCUT_HEIGHT = 1.25, 0.85
"""Sizes on the sheet [inches]. Heights: heading, production, gap after a type. Widths: a type's picture, the text
beside it, its edges, a child's picture, the space between children. Size of a type that is never cut."""


def type_colour(c: int) -> Colour:
    """The colour of fragment type `c`, softened for large surfaces."""
    r, g, b = (round(0.72 * part + 0.28 * 214) for part in nth_colour(c))
    return r, g, b


@dataclass(frozen=True, eq=False)
class _GrammarSheet:
    """A sheet on which the types of a grammar are drawn.

    Attributes:
        sheet: to draw on.
        grammar: to be drawn.
        typical: the typical fragment of every type.
        portraits: of these.
    """

    sheet: Sheet
    grammar: Grammar
    typical: Sequence["TypicalFragment"]
    portraits: Sequence[Body]

    def draw_portrait(self, c: int, middle: tuple[float, float], width: float, height: float) -> None:
        """Draw type `c` in at most `width` x `height` inches; the longest type fills the width."""
        share = (self.typical[c].length / max(fragment.length for fragment in self.typical)) ** SIZE_EXPONENT
        body = [self.portraits[c]]
        wanted = scale_to_fit(body, PORTRAIT, width * share, np.inf)
        self.sheet.place(body, PORTRAIT, middle, min(scale_to_fit(body, PORTRAIT, width, height), wanted))

    def draw_facts(self, c: int, x: float, y: float) -> None:
        """Write the name, share and length of a type."""
        self.sheet.write(x, y - 0.12, f"c{c}", fontsize=9.5, fontweight="bold")
        self.sheet.write(x, y + 0.03, f"{100 * self.grammar.frequencies[c]:.0f} %", fontsize=7, color=QUIET_INK)
        self.sheet.write(x, y + 0.15, f"{1000 * self.typical[c].length:.0f} mm", fontsize=7, color=QUIET_INK)

    def draw_type(self, c: int, x: float, y: float) -> None:
        """Draw a type with its productions, its upper left corner at (x, y)."""
        options = sorted(self.grammar.options[c], key=lambda option: (-self.grammar.probabilities[option], option))
        middle = y + len(options) * ROW / 2.0
        self.draw_portrait(c, (x + PARENT / 2.0, middle), PARENT, min(0.72, len(options) * ROW + 0.05))
        self.draw_facts(c, x + PARENT + 0.06, middle)
        for i, option in enumerate(options):
            self._draw_production(option, x + PARENT + LABEL, middle, y + (i + 0.5) * ROW)

    def _draw_production(self, option: Production, x: float, start: float, y: float) -> None:
        """Draw an edge from (x, start) to the children in the row of height y."""
        share, end = self.grammar.probabilities[option], x + BRANCH
        curve = Curve([(x, start), (x + 0.3, start), (x + 0.12, y), (end, y)], [Curve.MOVETO, *[Curve.CURVE4] * 3])
        patch = PathPatch(curve, facecolor="none", linewidth=0.8 + 6.0 * share, capstyle="round")
        patch.set_edgecolor(rgb(type_colour(option.parent)))
        self.sheet.ax.add_patch(patch)
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
        self.sheet.write(end - 0.20, y, f"{share:.2f}".removeprefix("0"), fontsize=7.5, ha="center", bbox=box)
        for i, child in enumerate(option.children):
            middle = end + 0.10 + CHILD / 2.0 + i * (CHILD + SPACE)
            self.draw_portrait(child, (middle, y - 0.04), CHILD, ROW - 0.14)
            self.sheet.write(middle, y + 0.19, f"c{child}", fontsize=6.5, ha="center", color=QUIET_INK)


def draw_grammar(grammar: Grammar, typical: Sequence["TypicalFragment"], title: str) -> Figure:
    """The grammar on a sheet.

    Args:
        grammar: to be drawn.
        typical: the typical fragment of every type.
        title: heading of the sheet.
    """
    by_size = sorted(range(grammar.k), key=lambda c: (-typical[c].mesh.volume, c))
    heights = {c: len(grammar.options[c]) * ROW + GAP for c in by_size if c in grammar.options}
    uncut = [c for c in by_size if c not in heights]
    max_children = max((len(p.children) for p in grammar.probabilities), default=2)
    between = 0.45
    column_width = PARENT + LABEL + BRANCH + 0.13 + max_children * (CHILD + SPACE) + between
    columns = _columns(heights, column_width)
    body_height = max((sum(heights[c] for c in column) for column in columns), default=0.0)
    width = 2.0 * MARGIN + column_width * len(columns) - between
    per_row = max(1, int((width - 2.0 * MARGIN) // UNCUT_WIDTH))
    tail = (0.45 + UNCUT_HEIGHT * -(-len(uncut) // per_row)) if uncut else 0.0
    subtitle = (
        f"{grammar.k} fragment types, each shown by its typical training fragment, {len(grammar.probabilities)} "
        "productions with their probabilities; beside each type its share of the training fragments and its length"
    )
    with new_sheet(width, HEAD + body_height + tail + MARGIN, title, subtitle) as sheet:
        drawn = _GrammarSheet(
            sheet, grammar, typical, [portrait(t.mesh, type_colour(c)) for c, t in enumerate(typical)]
        )
        for i, column in enumerate(columns):
            y = HEAD
            for c in column:
                drawn.draw_type(c, MARGIN + i * column_width, y)
                y += heights[c]
        y = HEAD + body_height
        if uncut:
            sheet.line([(MARGIN, y + 0.05), (width - MARGIN, y + 0.05)], color=FAINT)
            sheet.write(MARGIN, y + 0.22, "never cut", color=QUIET_INK, fontweight="bold")
        for i, c in enumerate(uncut):
            x, middle = MARGIN + UNCUT_WIDTH * (i % per_row), y + 0.72 + UNCUT_HEIGHT * (i // per_row)
            drawn.draw_portrait(c, (x + 0.40, middle), 0.75, 0.46)
            drawn.draw_facts(c, x + 0.80, middle)
    return sheet.figure


def _columns(heights: dict[int, float], column_width: float) -> list[list[int]]:
    """The types in their order, split into columns so that the sheet is about 1.3 times as wide as high."""
    total = sum(heights.values())
    n_columns = max(1, round(float(np.sqrt(1.3 * total / column_width))))
    columns: list[list[int]] = [[]]
    used = 0.0
    for c, height in heights.items():
        if columns[-1] and used + height / 2.0 > total * len(columns) / n_columns:
            columns.append([])
        columns[-1].append(c)
        used += height
    return columns
