"""A parse tree drawn with pictures at its nodes: parents above, terminals in a row, productions as edges between."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path as Curve

from cutgrammar.geometry.arrays import Floats
from cutgrammar.grammar.production import Production
from cutgrammar.interfaces import TreeNode
from cutgrammar_dashboards.figures.layout.sheet import INK, PORTRAIT, QUIET_INK, Sheet, rgb, scale_to_fit, seen_size
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.palette import PLANE
from cutgrammar_dashboards.rendering.tree_layout import positions

MARKED = rgb(PLANE)
HALO = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
SIZE_EXPONENT = 0.6
"""Lengths are drawn to this power, so that small fragments can be seen beside large ones."""


@dataclass(frozen=True, eq=False)
class TreePicture:
    """A parse tree and how to draw it.

    Attributes:
        tree: nodes, parents before children, as in `Explanation.tree`.
        bodies: of the nodes; the start symbol has none and is drawn as an S.
        labels: texts under the nodes.
        shares: probability of the production that expands a node, where it is known.
        marked: nodes whose production stands out.
    """

    tree: Sequence[TreeNode]
    bodies: Mapping[int, Body]
    labels: Mapping[int, str]
    shares: Mapping[int, float] = field(default_factory=dict)
    marked: Collection[int] = ()

    @property
    def leaves(self) -> int:
        """Number of terminals."""
        return len(self.tree) - len({node.parent for node in self.tree if node.parent is not None})

    @property
    def depth(self) -> int:
        """Number of edges from the start symbol to the deepest terminal."""
        return round(float(positions(self.tree, down=1.0)[:, 1].max()))


def production_of(tree: Sequence[TreeNode], node: int) -> Production | None:
    """The production that expands a node; None for a terminal or the start symbol."""
    children = tuple(child.type for child in tree if child.parent == node and child.type is not None)
    parent = tree[node].type
    return None if parent is None or len(children) < 2 else Production(parent, children)


def draw_tree(sheet: Sheet, drawn: TreePicture, corner: tuple[float, float], across: float, down: float) -> Floats:
    """Draw a parse tree whose space has its upper left corner at `corner` of a sheet.

    Args:
        sheet: to draw on.
        drawn: the tree.
        corner: x, y [inches].
        across: width of a terminal [inches].
        down: height of a level [inches].

    Returns:
        (n, 2) middle of every node [inches].
    """
    middles = positions(drawn.tree, across, down) + np.array([corner[0] + across / 2.0, corner[1] + 0.35 * down])
    longest = max((max(seen_size([body], PORTRAIT)) for body in drawn.bodies.values()), default=1.0)
    for i, node in enumerate(drawn.tree):
        x, y = middles[i]
        children = [j for j, other in enumerate(drawn.tree) if other.parent == i]
        if children:
            _draw_edges(sheet, drawn, middles, i, children, down)
        if node.type is None:
            sheet.ax.add_patch(Circle((x, y), 0.13, facecolor="white", edgecolor=INK, linewidth=1.0, zorder=4.0))
            sheet.write(x, y, "S", ha="center", fontsize=9, fontweight="bold")
        elif i in drawn.bodies:
            body = [drawn.bodies[i]]
            length = max(seen_size(body, PORTRAIT))
            wanted = 0.86 * across * (length / longest) ** SIZE_EXPONENT / length
            sheet.place(body, PORTRAIT, (x, y), min(wanted, scale_to_fit(body, PORTRAIT, 0.86 * across, 0.42 * down)))
        if i in drawn.labels:
            sheet.write(x, y + 0.29 * down, drawn.labels[i], ha="center", fontsize=7.5, bbox=HALO)
    return np.asarray(middles)


def _draw_edges(
    sheet: Sheet, drawn: TreePicture, middles: Floats, node: int, children: Sequence[int], down: float
) -> None:
    """Draw edges from a node to a point below it, where they branch to the children."""
    is_marked = node in drawn.marked
    x, y = middles[node]
    start = y + 0.13 if drawn.tree[node].type is None else y + 0.34 * down
    branch, end = y + 0.46 * down, y + 0.76 * down
    for child in children:
        points = [(x, start), (x, branch), (x, branch), (middles[child, 0], branch), (middles[child, 0], end)]
        patch = PathPatch(Curve(points, [Curve.MOVETO, Curve.LINETO, *[Curve.CURVE4] * 3]), capstyle="round")
        patch.set(facecolor="none", edgecolor=MARKED if is_marked else "#9aa4ae")
        patch.set(linewidth=2.6 if is_marked else 1.2, zorder=2.5 if is_marked else 2.0)
        sheet.ax.add_patch(patch)
    share = drawn.shares.get(node)
    if share is not None:
        text = "1" if share > 0.995 else f"{share:.2f}".removeprefix("0")
        style = {"color": MARKED, "fontweight": "bold"} if is_marked else {"color": QUIET_INK}
        sheet.write(x + 0.05, y + 0.42 * down, text, fontsize=6.5, bbox=HALO, **style)
