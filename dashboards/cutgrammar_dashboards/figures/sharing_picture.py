"""The paper's Fig. 1 on our data: what was seen of cutting one object plans the cutting of another.

On the left the parse tree of a demonstration, on the right the one inferred for a goal; the production that they share
stands out in both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.grammar.production import Production
from cutgrammar.interfaces import TreeNode
from cutgrammar_dashboards.figures.grammar_picture import type_colour
from cutgrammar_dashboards.figures.layout.sheet import (
    FAINT,
    INK,
    QUIET_INK,
    STYLE,
    line,
    portrait,
    put,
    scale_to_fit,
    sheet,
    words,
)
from cutgrammar_dashboards.figures.layout.spread import apart
from cutgrammar_dashboards.figures.layout.tree_picture import MARKED, TreePicture, draw_tree, production_of
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import Colour

MARGIN, HEAD, ACROSS, DOWN, BETWEEN = 0.35, 2.45, 0.98, 1.02, 0.8
"""The page's margin and heading, a terminal's place, a level, the gap between the trees [inches]."""
RAW: Colour = (214, 190, 150)
WANTED: Colour = (120, 168, 214)


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two parse trees.

    Attributes:
        title, subtitle: what it is.
        tree: with pictures.
        start, goal: what is cut into what.
    """

    title: str
    subtitle: str
    tree: TreePicture
    start: Configuration
    goal: Configuration


def draw_sharing(seen: Side, planned: Side, shared: Production, title: str) -> Figure:
    """Two parse trees side by side.

    Args:
        seen: the demonstration.
        planned: the parse tree inferred.
        shared: the production that stands out.
        title: the sheet's heading.
    """
    widths = [max(side.tree.leaves * ACROSS, 4.2) for side in (seen, planned)]
    depth = max(seen.tree.depth, planned.tree.depth)
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(2.0 * MARGIN + sum(widths) + BETWEEN, HEAD + (depth + 1) * DOWN)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        told = str(shared).replace("->", "→")
        words(ax, MARGIN, 0.62, f"The production {told} is in both", color=MARKED, fontsize=9.5, fontweight="bold")
        x = MARGIN
        for side, width in zip((seen, planned), widths, strict=True):
            words(ax, x, 1.02, side.title, fontsize=10.5, fontweight="bold")
            words(ax, x, 1.22, side.subtitle, color=QUIET_INK)
            free = (width - side.tree.leaves * ACROSS) / 2.0
            _wanted(ax, side, x)
            draw_tree(ax, _marked(side.tree, shared), (x + free, HEAD), ACROSS, DOWN)
            x += width + BETWEEN
        middle = MARGIN + widths[0] + BETWEEN / 2.0
        line(ax, [(middle, 0.95), (middle, HEAD + (depth + 0.9) * DOWN)], color=FAINT)
    return figure


def _wanted(ax: Axes, side: Side, x: float) -> None:
    """What is cut, an arrow, and into what."""
    shifts = apart(side.goal, [0] * len(side.goal), 0.35, 0.0)
    start = [body_of_fragment(fragment, RAW) for fragment in side.start]
    goal = [body_of_fragment(fragment, WANTED, shift) for fragment, shift in zip(side.goal, shifts, strict=True)]
    scale = min(scale_to_fit(bodies, FRONT, 1.7, 0.9) for bodies in (start, goal))
    put(ax, start, FRONT, (x + 0.9, 1.85), scale)
    arrow = {"arrowstyle": "->", "color": INK}
    ax.annotate("", (x + 2.2, 1.85), (x + 1.9, 1.85), arrowprops=arrow, zorder=5)
    put(ax, goal, FRONT, (x + 3.2, 1.85), scale)


def demonstrated_tree(demonstration: Demonstration, types: Sequence[int]) -> TreePicture:
    """The parse tree of a demonstration, every node shown by the fragment itself.

    Args:
        demonstration: whose cuts, without those undone, are the productions.
        types: type of every fragment, by its id.
    """
    products = {cut.fragment: cut.products for cut in demonstration.cuts if not cut.undone}
    tree, ids = [TreeNode(None, None)], [-1]
    pending = [(fragment, 0) for fragment in reversed(demonstration.alive(0))]
    while pending:
        fragment, parent = pending.pop()
        tree.append(TreeNode(parent, types[fragment]))
        ids.append(fragment)
        pending += [(product, len(tree) - 1) for product in reversed(products.get(fragment, ()))]
    bodies = {
        node: portrait(demonstration.fragments[fragment].mesh, type_colour(types[fragment]))
        for node, fragment in enumerate(ids)
        if node
    }
    return TreePicture(tree, bodies, {node: f"c{types[fragment]}" for node, fragment in enumerate(ids) if node})


def _marked(drawn: TreePicture, shared: Production) -> TreePicture:
    nodes = [node for node in range(len(drawn.tree)) if production_of(drawn.tree, node) == shared]
    return TreePicture(drawn.tree, drawn.bodies, drawn.labels, drawn.shares, nodes)
