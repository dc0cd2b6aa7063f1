"""The search for a cut in a recording: the best score over its rounds, and the best parse tree."""

from collections.abc import Callable, Set

import numpy as np
import rerun as rr

from cutgrammar.interfaces import Explanation, TreeNode
from cutgrammar_dashboards.recording import blueprint
from cutgrammar_dashboards.recording.gathered import Gathered
from cutgrammar_dashboards.recording.writer import PAUSE, Writer
from cutgrammar_dashboards.rendering.palette import PLANE, QUIET, Colour, nth_colour, pale
from cutgrammar_dashboards.rendering.tree_layout import positions

LEVEL = 90.0
"""Height of a level of the parse tree in its view."""


def show_search(writer: Writer, gathered: Gathered, why: Explanation) -> None:
    """Show how the best log posterior, or predicted IoU, rose, and advance `round` by the rounds of the search.

    Args:
        writer: of the recording.
        gathered: takes the series.
        why: holds the history of the search.
    """
    history = np.asarray(why.history, dtype=np.float64)
    if not len(history):
        return
    known = np.isfinite(history)
    rounds = writer.round + np.arange(len(history))
    if known.any():
        seconds = writer.seconds + PAUSE * (rounds[known] - rounds[-1]) / len(rounds)
        moments = writer.moments(seconds)._replace(rounds=rounds[known].astype(np.float64))
        gathered.add(blueprint.SEARCH, moments, history[known][:, None])
    writer.move_to(round_=int(rounds[-1]))


def show_tree(writer: Writer, why: Explanation, name_of: Callable[[int], str | None], cut: Set[int]) -> None:
    """Show the best parse tree, its terminals joined to the goal fragments that they are grounded to.

    The production that the cut carries out stands out: its left side is red, and all nodes but its right side are pale.

    Args:
        writer: of the recording.
        why: holds the tree.
        name_of: from the index of a current fragment to its name, None if it has none.
        cut: indices of the current fragments that are to be cut.
    """
    place = positions(why.tree, down=LEVEL)
    ids = [str(i) for i in range(len(why.tree))]
    divided = {i for i, node in enumerate(why.tree) if node.now is not None and node.now in cut}
    labels = [
        f"cut {_label(node, name_of)}" if i in divided else _label(node, name_of) for i, node in enumerate(why.tree)
    ]
    colours = [_colour(i, node, divided) for i, node in enumerate(why.tree)]
    edges = [(str(node.parent), str(i)) for i, node in enumerate(why.tree) if node.parent is not None]
    lowest = place[:, 1].max(initial=0.0) + LEVEL
    for i, node in enumerate(why.tree):
        if node.goal is not None:
            ids.append(f"goal {node.goal}")
            labels.append(f"g{node.goal}")
            colours.append(pale(QUIET if node.type is None else nth_colour(node.type)))
            edges.append((str(i), f"goal {node.goal}"))
            place = np.vstack([place, [place[i, 0], lowest]])
    writer.log(
        blueprint.TREE,
        rr.GraphNodes(ids, positions=place, labels=labels, colors=colours, show_labels=True),
        rr.GraphEdges(edges, graph_type="directed"),
    )


def _colour(index: int, node: TreeNode, divided: Set[int]) -> Colour:
    if index in divided:
        return PLANE
    colour = QUIET if node.type is None else nth_colour(node.type)
    return colour if node.parent in divided or not divided else pale(colour)


def _label(node: TreeNode, name_of: Callable[[int], str | None]) -> str:
    if node.type is None:
        return "S"
    name = None if node.now is None else name_of(node.now)
    return f"c{node.type}" if name is None else f"{name}: c{node.type}"
