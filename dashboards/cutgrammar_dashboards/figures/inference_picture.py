"""The paper's Fig. 2 on our data: one inference, from what is seen to the cut that is made.

(a) What p(c|z) says of every fragment, in grey; (b) the search for the best parse tree; (c) that parse tree, its
terminals grounded to the goal's fragments; (d) the production drawn from it, and its cutting plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
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
    PORTRAIT,
    QUIET_INK,
    STYLE,
    chart,
    line,
    portrait,
    put,
    scale_to_fit,
    sheet,
    words,
)
from cutgrammar_dashboards.figures.layout.spread import apart
from cutgrammar_dashboards.figures.layout.tree_picture import MARKED, TreePicture, draw_tree, production_of
from cutgrammar_dashboards.recording.scene import quad
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT
from cutgrammar_dashboards.rendering.palette import Colour

if TYPE_CHECKING:  # typing fragments needs torch, which takes seconds to import; drawing does without it
    from cutgrammar.learning.typical_fragments import TypicalFragment

MARGIN, LEFT, ROW, ACROSS, DOWN = 0.35, 4.7, 0.36, 0.98, 1.02
"""Margin, width of the left side, height of a row of p(c|z), width of a terminal, height of a level [inches]."""
PLAIN: Colour = (214, 190, 150)


@dataclass(frozen=True, eq=False)
class Inference:
    """One step of a trial under the paper's method.

    Attributes:
        now, goal: the current fragments and the goal's.
        log_current, log_goal: (m, k), (g, k) log p(c|z) of them.
        cut: what was planned.
        why: its explanation.
        products: what the cut made.
        grammar: that the parse tree was derived from.
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


def draw_inference(shown: Inference, title: str) -> Figure:
    """One inference on a sheet.

    Args:
        shown: the inference.
        title: the sheet's heading.
    """
    tree = tree_of(shown)
    rows = len(shown.now) + len(shown.goal)
    strips = 2.62 + rows * ROW
    height = max(strips + 2.75, 1.0 + (tree.depth + 1) * DOWN + 1.1 + 2.2)
    width = 2.0 * MARGIN + LEFT + 0.6 + max(tree.leaves * ACROSS, 5.6)
    with matplotlib.rc_context(STYLE):
        figure, ax = sheet(width, height + MARGIN)
        words(ax, MARGIN, 0.36, title, fontsize=13, fontweight="bold")
        _scenes(ax, shown)
        _strips(ax, shown, 2.62)
        _search(figure, ax, shown, strips + 0.45)
        right = MARGIN + LEFT + 0.6
        _heading(ax, right, 0.82, "c", "the best parse tree; dotted: the goal fragments its terminals are grounded to")
        place = draw_tree(ax, tree, (right, 1.0), ACROSS, DOWN)
        level = float(place[:, 1].max()) + 0.98
        _grounding(ax, shown, place, level)
        _cut(ax, shown, right, level + 0.85)
    return figure


def tree_of(shown: Inference) -> TreePicture:
    """The parse tree inferred: current fragments as they are, all else as typical fragments of their types."""
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
    return TreePicture(tree, bodies, labels, shares, [i for i in _expanded(shown) if i in shares])


def _expanded(shown: Inference) -> list[int]:
    """The node of the current fragment that is cut."""
    meant = _meant(shown)
    return [i for i, node in enumerate(shown.why.tree) if node.now == meant]


def _meant(shown: Inference) -> int:
    away = [float(np.linalg.norm(fragment.p_WC - shown.cut.p_WC[0])) for fragment in shown.now]
    return int(np.argmin(away))


def _types(shown: Inference) -> tuple[dict[int, int], dict[int, int]]:
    """The type that the parse tree gives to current fragments and to goal fragments, by index."""
    now, goal = dict[int, int](), dict[int, int]()
    for node in shown.why.tree:
        if node.type is not None and node.now is not None:
            now[node.now] = node.type
        if node.type is not None and node.goal is not None:
            goal[node.goal] = node.type
    return now, goal


def _heading(ax: Axes, x: float, y: float, letter: str, text: str) -> None:
    words(ax, x, y, f"({letter})", fontsize=9.5, fontweight="bold")
    words(ax, x + 0.28, y, text, fontsize=9)


def _scenes(ax: Axes, shown: Inference) -> None:
    now, goal = _types(shown)
    half = LEFT / 2.0
    for k, (name, fragments, types, spread) in enumerate(
        (("current fragments", shown.now, now, 0.12), ("goal", shown.goal, goal, 0.45))
    ):
        x = MARGIN + k * half
        words(ax, x, 0.82, name, fontsize=9, fontweight="bold")
        shifts = apart(fragments, [0] * len(fragments), spread, 0.0)
        bodies = [
            body_of_fragment(f, type_colour(types[i]) if i in types else PLAIN, shift)
            for i, (f, shift) in enumerate(zip(fragments, shifts, strict=True))
        ]
        put(ax, bodies, FRONT, (x + half / 2.0 - 0.1, 1.55), scale_to_fit(bodies, FRONT, half - 0.3, 1.15))


def _strips(ax: Axes, shown: Inference, y: float) -> None:
    """A row of grey cells for every fragment, one a type."""
    k = shown.grammar.k
    _heading(ax, MARGIN, y - 0.34, "a", "p(c|z) of every fragment; framed: its type in the best parse tree")
    left, wide = MARGIN + 1.05, LEFT - 1.15
    cell = wide / k
    for c in range(0, k, 5 if k > 12 else 1):
        words(ax, left + (c + 0.5) * cell, y - 0.08, f"c{c}", ha="center", fontsize=6.5, color=QUIET_INK)
    now, goal = _types(shown)
    rows = [(f"#{i}", f, shown.log_current[i], now.get(i)) for i, f in enumerate(shown.now)]
    rows += [(f"g{j}", f, shown.log_goal[j], goal.get(j)) for j, f in enumerate(shown.goal)]
    bodies = [portrait(f.shape, PLAIN if c is None else type_colour(c)) for _, f, _, c in rows]
    for n, ((name, _, log_p, kind), body) in enumerate(zip(rows, bodies, strict=True)):
        top = y + n * ROW + (0.06 if n >= len(shown.now) else 0.0)
        middle = top + ROW / 2.0
        words(ax, MARGIN, middle, name, fontsize=8)
        put(ax, [body], PORTRAIT, (MARGIN + 0.62, middle), scale_to_fit([body], PORTRAIT, 0.62, ROW - 0.08))
        grey = 1.0 - np.exp(log_p)[None, :]
        limits = ax.get_xlim(), ax.get_ylim()
        box = (left, left + wide, middle + 0.11, middle - 0.11)
        image = ax.imshow(
            grey, cmap="gray", vmin=0.0, vmax=1.0, extent=box, aspect="auto", zorder=2.0, interpolation="nearest"
        )
        image.set_gid(CELLS)
        ax.set_xlim(limits[0])
        ax.set_ylim(limits[1])
        ax.add_patch(Rectangle((left, middle - 0.11), wide, 0.22, facecolor="none", edgecolor=FAINT, linewidth=0.7))
        if kind is not None:
            frame = Rectangle(
                (left + kind * cell, middle - 0.13), cell, 0.26, facecolor="none", linewidth=1.8, zorder=4.0
            )
            frame.set_edgecolor(_shade(type_colour(kind)))
            ax.add_patch(frame)


def _search(figure: Figure, ax: Axes, shown: Inference, y: float) -> None:
    why = shown.why
    told = f"the search: {why.rollouts} rollouts, {why.dead_ends} of them dead ends"
    _heading(ax, MARGIN, y, "b", told)
    axes = chart(figure, MARGIN + 0.55, y + 0.22, LEFT - 0.75, 1.35)
    history = np.array(why.history)
    axes.step(np.arange(1, len(history) + 1), history, where="post", color=INK, linewidth=1.4)
    axes.set_xlabel("round", fontsize=7.5)
    axes.set_ylabel("best log posterior", fontsize=7.5)
    axes.tick_params(labelsize=7, length=2.5)
    axes.grid(True, axis="y", color=FAINT, linewidth=0.6)
    terms = f"prior {why.log_prior:.1f}  +  shape {why.log_shape:.1f}  +  layout {why.log_layout:.1f}"
    words(ax, MARGIN + 0.55, y + 2.08, f"log posterior {why.log_posterior:.1f}  =  {terms}", fontsize=8)


def _grounding(ax: Axes, shown: Inference, place: Floats, level: float) -> None:
    """The goal's fragments in a row at height `level`, each under the terminal that is grounded to it."""
    goal = {node.goal: i for i, node in enumerate(shown.why.tree) if node.goal is not None}
    bodies = {j: portrait(shown.goal[j].shape, type_colour(shown.why.tree[i].type or 0)) for j, i in goal.items()}
    scale = min((scale_to_fit([body], PORTRAIT, 0.86 * ACROSS, 0.56) for body in bodies.values()), default=1.0)
    for j, i in goal.items():
        x, y = place[i]
        line(ax, [(x, y + 0.42 * DOWN), (x, level - 0.32)], linestyle=(0, (1.2, 2.4)), linewidth=1.3)
        put(ax, [bodies[j]], PORTRAIT, (x, level), scale)
        words(ax, x, level + 0.40, f"g{j}", ha="center", fontsize=8)


def _cut(ax: Axes, shown: Inference, x: float, y: float) -> None:
    """The fragment with the plane, and what became of it."""
    _heading(ax, x, y, "d", f"the production drawn, {shown.why.production.replace('->', '→')}, and its cutting plane")
    fragment = shown.now[_meant(shown)]
    c = _types(shown)[0].get(_meant(shown))
    colour = PLAIN if c is None else type_colour(c)
    body = [body_of_fragment(fragment, colour)]
    shifts = apart(shown.products, [0] * len(shown.products), 0.25, 0.0) if shown.products else []
    after = [body_of_fragment(f, colour, shift) for f, shift in zip(shown.products, shifts, strict=True)]
    scale = min(scale_to_fit(bodies, FRONT, 2.2, 0.95) for bodies in (body, after or body))
    seen = put(ax, body, FRONT, (x + 1.35, y + 0.90), scale)
    corners = seen(quad(shown.cut.plane_W, [fragment]))
    ax.add_patch(Polygon(corners, facecolor=MARKED, edgecolor=MARKED, alpha=0.35, linewidth=1.2, zorder=4.0))
    if after:
        ax.annotate(
            "", (x + 3.1, y + 0.9), (x + 2.75, y + 0.9), arrowprops={"arrowstyle": "->", "color": INK}, zorder=5
        )
        put(ax, after, FRONT, (x + 4.4, y + 0.90), scale)


def _shade(colour: Colour) -> tuple[float, float, float]:
    r, g, b = (0.8 * part / 255.0 for part in colour)
    return r, g, b
