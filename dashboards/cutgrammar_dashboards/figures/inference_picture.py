"""The paper's Fig. 2 on our data: one inference, from the fragments seen to the cut made.

(a) p(c|z) of every fragment, in grey; (b) the search for the best parse tree; (c) that parse tree, its terminals
grounded to the goal's fragments; (d) the production drawn from it, and its cutting plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.grammar.production import Grammar
from cutgrammar.interfaces import Cut, Explanation
from cutgrammar_dashboards.figures.grammar_picture import type_colour
from cutgrammar_dashboards.figures.layout.sheet import (
    CELLS,
    FAINT,
    INK,
    MARGIN,
    PORTRAIT,
    QUIET_INK,
    Sheet,
    new_sheet,
    portrait,
    rgb,
    scale_to_fit,
)
from cutgrammar_dashboards.figures.layout.spread import bodies_apart
from cutgrammar_dashboards.figures.layout.tree_picture import MARKED, TreePicture, draw_tree, production_of
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.explanation_text import criterion, score_text
from cutgrammar_dashboards.rendering.palette import UNCUT, Colour
from cutgrammar_dashboards.rendering.placement import quad

if TYPE_CHECKING:  # this module imports torch, which takes seconds and is not needed for drawing
    from cutgrammar.learning.typical_fragments import TypicalFragment

LEFT, ROW, ACROSS, DOWN = 4.7, 0.36, 0.98, 1.02
"""Width of the left side, height of a row of p(c|z), width of a terminal, height of a level [inches]."""
HALF_BAR = 0.11
"""Half the height of a bar of p(c|z) [inches]."""


@dataclass(frozen=True, eq=False)
class Inference:
    """One step of a trial under the paper's method.

    Attributes:
        now, goal: the current fragments and the goal's.
        log_current, log_goal: (m, k), (g, k) log p(c|z) of them.
        cut: the planned cut.
        why: its explanation.
        products: of the cut.
        grammar: from which the parse tree was derived.
        typical: the typical fragment of every type.
    """

    now: Configuration
    goal: Configuration
    log_current: Floats
    log_goal: Floats
    cut: Cut
    why: Explanation
    products: Configuration
    grammar: Grammar
    typical: Sequence["TypicalFragment"]

    @property
    def target(self) -> int:
        """Index of the current fragment that is cut."""
        return int(np.argmin([np.linalg.norm(fragment.p_WC - self.cut.p_WC[0]) for fragment in self.now]))

    @property
    def types_now(self) -> list[int | None]:
        """The type that the parse tree gives to each current fragment, if any."""
        types = {node.now: node.type for node in self.why.tree}
        return [types.get(i) for i in range(len(self.now))]

    @property
    def types_goal(self) -> list[int | None]:
        """The type that the parse tree gives to each goal fragment, if any."""
        types = {node.goal: node.type for node in self.why.tree}
        return [types.get(j) for j in range(len(self.goal))]


def draw_inference(shown: Inference, title: str) -> Figure:
    """One inference on a sheet."""
    tree = tree_of(shown)
    top = 2.62
    bottom = top + (len(shown.now) + len(shown.goal)) * ROW
    height = max(bottom + 2.75, 1.0 + (tree.depth + 1) * DOWN + 1.1 + 2.2) + MARGIN
    right = MARGIN + LEFT + 0.6
    with new_sheet(right + max(tree.leaves * ACROSS, 5.6) + MARGIN, height, title) as sheet:
        _draw_configurations(sheet, shown)
        _draw_types(sheet, shown, top)
        _draw_search(sheet, shown.why, bottom + 0.45)
        _head(sheet, right, 0.82, "c", "the best parse tree; dotted: the goal fragments its terminals are grounded to")
        nodes = draw_tree(sheet, tree, (right, 1.0), ACROSS, DOWN)
        level = float(nodes[:, 1].max()) + 0.98
        _draw_grounding(sheet, shown, nodes, level)
        _draw_cut(sheet, shown, right, level + 0.85)
    return sheet.figure


def tree_of(shown: Inference) -> TreePicture:
    """The inferred parse tree: current fragments as they are, other nodes as typical fragments of their types."""
    tree = shown.why.tree
    bodies, labels, shares = {}, {}, {}
    for i, node in enumerate(tree):
        if node.type is None:
            continue
        shape = shown.typical[node.type].mesh if node.now is None else shown.now[node.now].shape
        bodies[i] = portrait(shape, type_colour(node.type))
        labels[i] = f"c{node.type}" if node.now is None else f"#{node.now}: c{node.type}"
        production = production_of(tree, i)
        if production is not None and production in shown.grammar.probabilities:
            shares[i] = shown.grammar.probabilities[production]
    marked = [i for i in shares if tree[i].now == shown.target]
    return TreePicture(tree, bodies, labels, shares, marked)


def _colour(c: int | None) -> Colour:
    return UNCUT if c is None else type_colour(c)


def _head(sheet: Sheet, x: float, y: float, letter: str, text: str) -> None:
    sheet.write(x, y, f"({letter})", fontsize=9.5, fontweight="bold")
    sheet.write(x + 0.28, y, text, fontsize=9)


def _draw_configurations(sheet: Sheet, shown: Inference) -> None:
    half = LEFT / 2.0
    for x, name, fragments, types, spread in (
        (MARGIN, "current fragments", shown.now, shown.types_now, 0.12),
        (MARGIN + half, "goal", shown.goal, shown.types_goal, 0.45),
    ):
        sheet.write(x, 0.82, name, fontsize=9, fontweight="bold")
        bodies = bodies_apart(fragments, [_colour(c) for c in types], spread)
        sheet.place_fitted(bodies, FRONT, (x + half / 2.0 - 0.1, 1.55), half - 0.3, 1.15)


def _draw_types(sheet: Sheet, shown: Inference, y: float) -> None:
    """Draw p(c|z): a bar for every fragment, a grey cell for every type."""
    k = shown.grammar.k
    _head(sheet, MARGIN, y - 0.34, "a", "p(c|z) of every fragment; framed: its type in the best parse tree")
    left, width = MARGIN + 1.05, LEFT - 1.15
    cell = width / k
    for c in range(0, k, 5 if k > 12 else 1):
        sheet.write(left + (c + 0.5) * cell, y - 0.08, f"c{c}", ha="center", fontsize=6.5, color=QUIET_INK)
    names = [*(f"#{i}" for i in range(len(shown.now))), *(f"g{j}" for j in range(len(shown.goal)))]
    types = [*shown.types_now, *shown.types_goal]
    probabilities = np.exp(np.concatenate([shown.log_current, shown.log_goal]))
    for n, fragment in enumerate((*shown.now, *shown.goal)):
        middle = y + (n + 0.5) * ROW + (0.06 if n >= len(shown.now) else 0.0)
        kind = types[n]
        sheet.write(MARGIN, middle, names[n], fontsize=8)
        body = [portrait(fragment.shape, _colour(kind))]
        sheet.place_fitted(body, PORTRAIT, (MARGIN + 0.62, middle), 0.62, ROW - 0.08)
        box = (left, left + width, middle + HALF_BAR, middle - HALF_BAR)
        style = {"cmap": "gray", "vmin": 0.0, "vmax": 1.0, "interpolation": "nearest", "gid": CELLS, "zorder": 2.0}
        sheet.pixels(1.0 - probabilities[n : n + 1], box, **style)
        frame = Rectangle((left, middle - HALF_BAR), width, 2.0 * HALF_BAR, facecolor="none", linewidth=0.7)
        frame.set_edgecolor(FAINT)
        sheet.ax.add_patch(frame)
        if kind is not None:
            corner, height = (left + kind * cell, middle - HALF_BAR - 0.02), 2.0 * HALF_BAR + 0.04
            frame = Rectangle(corner, cell, height, facecolor="none", linewidth=1.8, zorder=4.0)
            frame.set_edgecolor(rgb(type_colour(kind), 0.8))
            sheet.ax.add_patch(frame)


def _draw_search(sheet: Sheet, why: Explanation, y: float) -> None:
    _head(sheet, MARGIN, y, "b", f"the search: {why.rollouts} rollouts, {why.dead_ends} of them dead ends")
    axes = sheet.chart(MARGIN + 0.55, y + 0.22, LEFT - 0.75, 1.35)
    axes.step(np.arange(1, len(why.history) + 1), why.history, where="post", color=INK, linewidth=1.4)
    axes.set_xlabel("round", fontsize=7.5)
    axes.set_ylabel(f"best {criterion(why)}", fontsize=7.5)
    axes.tick_params(labelsize=7, length=2.5)
    axes.grid(True, axis="y", color=FAINT, linewidth=0.6)
    sheet.write(MARGIN + 0.55, y + 2.08, score_text(why), fontsize=8)


def _draw_grounding(sheet: Sheet, shown: Inference, nodes: Floats, level: float) -> None:
    """Draw the goal's fragments in a row at height `level`, each under the terminal that is grounded to it."""
    terminals = {node.goal: i for i, node in enumerate(shown.why.tree) if node.goal is not None}
    bodies = {j: portrait(shown.goal[j].shape, type_colour(shown.why.tree[i].type or 0)) for j, i in terminals.items()}
    scale = min((scale_to_fit([body], PORTRAIT, 0.86 * ACROSS, 0.56) for body in bodies.values()), default=1.0)
    for j, i in terminals.items():
        x, y = nodes[i]
        sheet.line([(x, y + 0.42 * DOWN), (x, level - 0.32)], linestyle=(0, (1.2, 2.4)), linewidth=1.3)
        sheet.place([bodies[j]], PORTRAIT, (x, level), scale)
        sheet.write(x, level + 0.40, f"g{j}", ha="center", fontsize=8)


def _draw_cut(sheet: Sheet, shown: Inference, x: float, y: float) -> None:
    """Draw the fragment with the cutting plane, and its products."""
    _head(sheet, x, y, "d", f"the production drawn, {shown.why.production.replace('->', '→')}, and its cutting plane")
    fragment, colour = shown.now[shown.target], _colour(shown.types_now[shown.target])
    before, after = (
        bodies_apart((fragment,), [colour], 0.0),
        bodies_apart(shown.products, [colour] * len(shown.products), 0.25),
    )
    scale = min(scale_to_fit(bodies, FRONT, 2.2, 0.95) for bodies in (before, after or before))
    to_sheet = sheet.place(before, FRONT, (x + 1.35, y + 0.90), scale)
    corners = to_sheet(quad(shown.cut.plane_W, [fragment]))
    sheet.ax.add_patch(Polygon(corners, facecolor=MARKED, edgecolor=MARKED, alpha=0.35, linewidth=1.2, zorder=4.0))
    if after:
        sheet.arrow(x + 2.75, x + 3.1, y + 0.9)
        sheet.place(after, FRONT, (x + 4.4, y + 0.90), scale)
