"""The search for a cut in a recording: the best score over its rounds, and the best parse tree."""

from collections.abc import Callable

import numpy as np
import rerun as rr

from cutgrammar.interfaces import Explanation, TreeNode
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.writer import PAUSE, Writer
from cutgrammar_dashboards.rendering.palette import QUIET, nth_colour
from cutgrammar_dashboards.rendering.tree_layout import positions

LEVEL = 90.0
"""Height of a level of the parse tree in its view."""


def show_search(writer: Writer, why: Explanation) -> None:
    """Show how the best log posterior, or predicted IoU, rose, and advance `round` by the rounds of the search."""
    history = np.asarray(why.history, dtype=np.float64)
    if not len(history):
        return
    known = np.isfinite(history)
    rounds = writer.round + np.arange(len(history))
    if known.any():
        seconds = writer.seconds + PAUSE * (rounds[known] - rounds[-1]) / len(rounds)
        indexes = [rr.TimeColumn("round", sequence=rounds[known]), rr.TimeColumn("time", duration=seconds)]
        writer.send(blueprint.SEARCH, indexes, rr.Scalars.columns(scalars=history[known]))
    writer.move_to(round_=int(rounds[-1]))


def show_tree(writer: Writer, why: Explanation, name_of: Callable[[int], str | None]) -> None:
    """Show the best parse tree, its terminals joined to the goal fragments that they are grounded to.

    Args:
        writer: of the recording.
        why: holds the tree.
        name_of: from the index of a current fragment to its name, None if it has none.
    """
    place = positions(why.tree, down=LEVEL)
    ids = [str(i) for i in range(len(why.tree))]
    labels = [_label(node, name_of) for node in why.tree]
    colours = [QUIET if node.type is None else nth_colour(node.type) for node in why.tree]
    edges = [(str(node.parent), str(i)) for i, node in enumerate(why.tree) if node.parent is not None]
    lowest = place[:, 1].max(initial=0.0) + LEVEL
    for i, node in enumerate(why.tree):
        if node.goal is not None:
            ids.append(f"goal {node.goal}")
            labels.append(f"g{node.goal}")
            colours.append(colours[i])
            edges.append((str(i), f"goal {node.goal}"))
            place = np.vstack([place, [place[i, 0], lowest]])
    writer.log(
        blueprint.TREE,
        rr.GraphNodes(ids, positions=place, labels=labels, colors=colours, show_labels=True),
        rr.GraphEdges(edges, graph_type="directed"),
    )


def _label(node: TreeNode, name_of: Callable[[int], str | None]) -> str:
    if node.type is None:
        return "S"
    name = None if node.now is None else name_of(node.now)
    return f"c{node.type}" if name is None else f"{name}: c{node.type}"
