"""A parse tree drawn with pictures at its nodes: parents above, terminals in a row, productions as edges between."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path as Curve

from cutgrammar.geometry.arrays import Floats
from cutgrammar.grammar.production import Production
from cutgrammar.interfaces import TreeNode
from cutgrammar_dashboards.figures.layout.sheet import INK, PORTRAIT, QUIET_INK, put, scale_to_fit, seen_size, words
from cutgrammar_dashboards.figures.layout.tree_layout import positions
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.palette import PLANE

MARKED = "#{:02x}{:02x}{:02x}".format(*PLANE)


@dataclass(frozen=True, eq=False)
class TreePicture:
    """A parse tree and how to draw it.

    Attributes:
        tree: nodes, parents before children, as in `Explanation.tree`.
        bodies: node -> its picture; a node without one is a dot, the start symbol an S.
        labels: node -> words under its picture.
        shares: node -> probability of the production that expands it, where it is known.
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
        depth = [0] * len(self.tree)
        for i, node in enumerate(self.tree):
            if node.parent is not None:
                depth[i] = depth[node.parent] + 1
        return max(depth)


def production_of(tree: Sequence[TreeNode], node: int) -> Production | None:
    """The production that expands a node, None for a terminal or the start symbol."""
    children = tuple(child.type for child in tree if child.parent == node and child.type is not None)
    mine = tree[node].type
    return None if mine is None or len(children) < 2 else Production(mine, children)


def draw_tree(ax: Axes, drawn: TreePicture, corner: tuple[float, float], across: float, down: float) -> Floats:
    """Draw a parse tree with the upper left corner of its place at `corner` of a sheet.

    Args:
        ax: of the sheet.
        drawn: the tree.
        corner: x, y [inches].
        across: width of a terminal's place [inches].
        down: height of a level [inches].

    Returns:
        (n, 2) middle of every node [inches].
    """
    place = positions(drawn.tree, across, down) + np.array([corner[0] + across / 2.0, corner[1] + 0.35 * down])
    longest = max((max(seen_size([body], PORTRAIT)) for body in drawn.bodies.values()), default=1.0)
    for i, node in enumerate(drawn.tree):
        children = [j for j, other in enumerate(drawn.tree) if other.parent == i]
        if children:
            _edges(ax, drawn, place, i, children, down)
        if node.type is None:
            ax.add_patch(Circle(tuple(place[i]), 0.13, facecolor="white", edgecolor=INK, linewidth=1.0, zorder=4.0))
            words(ax, place[i, 0], place[i, 1], "S", ha="center", fontsize=9, fontweight="bold")
        elif i in drawn.bodies:
            body = [drawn.bodies[i]]
            long = max(seen_size(body, PORTRAIT))
            wide = 0.86 * across * (long / longest) ** 0.6
            scale = min(wide / long, scale_to_fit(body, PORTRAIT, 0.86 * across, 0.42 * down))
            put(ax, body, PORTRAIT, (place[i, 0], place[i, 1]), scale)
        if i in drawn.labels:
            words(ax, place[i, 0], place[i, 1] + 0.29 * down, drawn.labels[i], ha="center", fontsize=7.5, bbox=_HALO)
    return np.asarray(place)


_HALO = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}


def _edges(ax: Axes, drawn: TreePicture, place: Floats, node: int, children: Sequence[int], down: float) -> None:
    """From a node to a point below it, where its production branches to the children."""
    marked = node in drawn.marked
    how = {"edgecolor": MARKED if marked else "#9aa4ae", "linewidth": 2.6 if marked else 1.2}
    x, y = place[node]
    start, branch, end = (
        y + 0.13 if drawn.tree[node].type is None else y + 0.34 * down,
        y + 0.46 * down,
        y + 0.76 * down,
    )
    for child in children:
        low = place[child, 0]
        points = [(x, start), (x, branch), (x, branch), (low, branch), (low, end)]
        curve = Curve(points, [Curve.MOVETO, Curve.LINETO, *[Curve.CURVE4] * 3])
        ax.add_patch(PathPatch(curve, facecolor="none", capstyle="round", zorder=2.5 if marked else 2.0, **how))
    share = drawn.shares.get(node)
    if share is not None:
        colour = MARKED if marked else QUIET_INK
        told = "1" if share > 0.995 else f"{share:.2f}".removeprefix("0")
        weight = "bold" if marked else "normal"
        words(ax, x + 0.05, y + 0.42 * down, told, fontsize=6.5, color=colour, fontweight=weight, bbox=_HALO)
