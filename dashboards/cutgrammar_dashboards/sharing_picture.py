"""The paper's Fig. 1 on our data: what was seen of cutting one object plans the cutting of another.

On the left the parse tree of a demonstration, on the right the one inferred for a goal; the production that they share
stands out in both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
from matplotlib.figure import Figure

from cutgrammar.demonstrations import Demonstration
from cutgrammar.grammar.production import Production
from cutgrammar.seams import TreeNode
from cutgrammar_dashboards.grammar_picture import type_colour
from cutgrammar_dashboards.sheet import FAINT, QUIET_INK, STYLE, line, portrait, sheet, words
from cutgrammar_dashboards.tree_picture import MARKED, TreePicture, draw_tree, production_of

MARGIN, HEAD, ACROSS, DOWN, BETWEEN = 0.35, 1.35, 0.98, 1.02, 0.8
"""The page's margin and heading, a terminal's place, a level, the gap between the trees [inches]."""


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two parse trees.

    Attributes:
        title, subtitle: what it is.
        tree: with pictures.
    """

    title: str
    subtitle: str
    tree: TreePicture


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
            draw_tree(ax, _marked(side.tree, shared), (x + free, HEAD), ACROSS, DOWN)
            x += width + BETWEEN
        middle = MARGIN + widths[0] + BETWEEN / 2.0
        line(ax, [(middle, 0.95), (middle, HEAD + (depth + 0.9) * DOWN)], color=FAINT)
    return figure


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
