"""Positions of the nodes of a parse tree: leaves in a row in their order, parents above their children."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.interfaces import TreeNode


def positions(tree: Sequence[TreeNode], across: float = 64.0, down: float = 90.0) -> Floats:
    """(n, 2) position x (right), y (down) of every node; no two nodes of one depth are closer than `across`.

    Args:
        tree: nodes, parents before children, as in `Explanation.tree`.
        across: distance between neighbouring leaves.
        down: distance between a parent and its children.

    Raises:
        ValueError: a node comes before its parent.
    """
    children: list[list[int]] = [[] for _ in tree]
    depth = np.zeros(len(tree))
    for i, node in enumerate(tree):
        if node.parent is None:
            continue
        if not 0 <= node.parent < i:
            raise ValueError(f"node {i} comes before its parent {node.parent}")
        children[node.parent].append(i)
        depth[i] = depth[node.parent] + 1
    x = np.zeros(len(tree))
    for column, leaf in enumerate(_leaves(tree, children)):
        x[leaf] = column
    for i in reversed(range(len(tree))):
        if children[i]:
            x[i] = (x[children[i][0]] + x[children[i][-1]]) / 2.0
    return np.stack([x * across, depth * down], axis=1)


def _leaves(tree: Sequence[TreeNode], children: Sequence[Sequence[int]]) -> list[int]:
    """Indices of the leaves from left to right; without recursion, for trees may be deep."""
    leaves = []
    pending = [i for i in reversed(range(len(tree))) if tree[i].parent is None]
    while pending:
        i = pending.pop()
        if not children[i]:
            leaves.append(i)
        pending.extend(reversed(children[i]))
    return leaves
