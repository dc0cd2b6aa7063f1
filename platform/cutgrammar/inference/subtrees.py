"""Taking parse trees apart and putting them side by side: what is left of a plan when one of its cuts is made."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.inference.parse_tree import START, ParseTree
from cutgrammar.inference.search import GroundedTree


def end_of(tree: ParseTree, node: int) -> int:
    """The first node after the subtree of `node`, which in preorder is one block."""
    last = node + 1
    while last < len(tree.types) and tree.parents[last] >= node:
        last += 1
    return last


def subtree(found: GroundedTree, node: int) -> GroundedTree:
    """The tree whose only root is `node`, with its part of the grounding; its posterior is not known (NaN)."""
    tree, end = found.tree, end_of(found.tree, node)
    parents = tree.parents[node:end] - node
    parents[0] = START
    inside = (tree.terminals >= node) & (tree.terminals < end)
    part = ParseTree(tree.types[node:end], parents, tree.productions[node:end])
    return GroundedTree(part, found.grounding[inside], float("nan"))


def side_by_side(parts: Sequence[GroundedTree]) -> GroundedTree:
    """One tree with the roots of all parts, in order; the log posteriors add up."""
    starts = np.cumsum([0] + [len(part.tree.types) for part in parts])
    parents = [
        np.where(part.tree.parents == START, START, part.tree.parents + start)
        for part, start in zip(parts, starts, strict=False)
    ]
    return GroundedTree(
        ParseTree(
            np.concatenate([part.tree.types for part in parts]),
            np.concatenate(parents),
            np.concatenate([part.tree.productions for part in parts]),
        ),
        np.concatenate([part.grounding for part in parts]),
        sum(part.log_posterior for part in parts),
    )
