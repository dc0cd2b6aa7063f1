"""The paper's Fig. 1 on our data: a production seen when one object was cut helps to plan the cutting of another.

On the left the parse tree of a demonstration, on the right the one inferred for a goal; the production that they share
stands out in both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from matplotlib.figure import Figure

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.grammar.production import Production
from cutgrammar.interfaces import TreeNode
from cutgrammar_dashboards.figures.grammar_picture import type_colour
from cutgrammar_dashboards.figures.layout.sheet import (
    FAINT,
    MARGIN,
    QUIET_INK,
    Sheet,
    new_sheet,
    portrait,
    scale_to_fit,
)
from cutgrammar_dashboards.figures.layout.spread import bodies_apart
from cutgrammar_dashboards.figures.layout.tree_picture import MARKED, TreePicture, draw_tree, production_of
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import GOAL, UNCUT

HEAD, ACROSS, DOWN, BETWEEN = 2.45, 0.98, 1.02, 0.8
"""Height of the heading, width of a terminal, height of a level, the gap between the trees [inches]."""


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two parse trees.

    Attributes:
        title, subtitle: its heading.
        tree: the parse tree.
        start, goal: the configurations that it leads from and to.
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
        planned: the inferred parse tree.
        shared: the production that stands out.
        title: heading of the sheet.
    """
    widths = [max(side.tree.leaves * ACROSS, 4.2) for side in (seen, planned)]
    bottom = HEAD + (max(seen.tree.depth, planned.tree.depth) + 1) * DOWN
    with new_sheet(2.0 * MARGIN + sum(widths) + BETWEEN, bottom, title) as sheet:
        text = f"The production {str(shared).replace('->', '→')} is in both"
        sheet.write(MARGIN, 0.62, text, color=MARKED, fontsize=9.5, fontweight="bold")
        x = MARGIN
        for side, width in zip((seen, planned), widths, strict=True):
            sheet.write(x, 1.02, side.title, fontsize=10.5, fontweight="bold")
            sheet.write(x, 1.22, side.subtitle, color=QUIET_INK)
            _draw_configurations(sheet, side, x)
            left = x + (width - side.tree.leaves * ACROSS) / 2.0
            draw_tree(sheet, _marked(side.tree, shared), (left, HEAD), ACROSS, DOWN)
            x += width + BETWEEN
        middle = MARGIN + widths[0] + BETWEEN / 2.0
        sheet.line([(middle, 0.95), (middle, bottom - 0.1 * DOWN)], color=FAINT)
    return sheet.figure


def _draw_configurations(sheet: Sheet, side: Side, x: float) -> None:
    """Draw the start, an arrow, and the goal."""
    start = bodies_apart(side.start, [UNCUT] * len(side.start), 0.0)
    goal = bodies_apart(side.goal, [GOAL] * len(side.goal), 0.35)
    scale = min(scale_to_fit(bodies, FRONT, 1.7, 0.9) for bodies in (start, goal))
    sheet.place(start, FRONT, (x + 0.9, 1.85), scale)
    sheet.arrow(x + 1.9, x + 2.2, 1.85)
    sheet.place(goal, FRONT, (x + 3.2, 1.85), scale)


def demonstrated_tree(demonstration: Demonstration, types: Sequence[int]) -> TreePicture:
    """The parse tree of a demonstration, with the fragments themselves at its nodes.

    Args:
        demonstration: its cuts are the productions, except those undone.
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
    labels = {node: f"c{types[fragment]}" for node, fragment in enumerate(ids) if node}
    bodies = {
        node: portrait(demonstration.fragments[fragment].mesh, type_colour(types[fragment]))
        for node, fragment in enumerate(ids)
        if node
    }
    return TreePicture(tree, bodies, labels)


def _marked(drawn: TreePicture, shared: Production) -> TreePicture:
    nodes = [node for node in range(len(drawn.tree)) if production_of(drawn.tree, node) == shared]
    return replace(drawn, marked=nodes)
