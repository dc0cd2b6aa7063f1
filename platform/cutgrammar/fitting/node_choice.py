"""Which nodes of a plan a move concerns, and what it asks to be cut again.

A move edits planes and tree of a `PlanState`, notes in `Scratch` below which nodes must be cut again and which planes
must be shifted or drawn anew, and returns the number of these nodes, 0 if it does not apply.
"""

import numpy as np
from numba import njit

from cutgrammar.fitting.plan_state import NONE, SHIFT, add_up_wanted, list_below
from cutgrammar.inference.draws import below, uniform

SIMILAR = 0.15
"""Nodes whose wanted volumes differ by this log ratio are exchanged half as often as those of equal volumes."""
ALSO_GOOD = 0.1
"""Share of leaves with an IoU of 1 that are taken when a leaf that fits badly is wanted."""


@njit(cache=True)
def inner_node(state, rng):  # type: ignore[no-untyped-def]
    """Draw an inner node; `NONE` if none is found."""
    for _ in range(30):
        node = below(rng, len(state.left))
        if state.left[node] != NONE:
            return node
    return NONE


@njit(cache=True)
def leaf_node(state, rng):  # type: ignore[no-untyped-def]
    """Draw a leaf."""
    while True:
        node = below(rng, len(state.left))
        if state.goal[node] != NONE:
            return node


@njit(cache=True)
def poor_leaf(state, rng):  # type: ignore[no-untyped-def]
    """Draw a leaf, the more readily the worse it fits."""
    leaf = leaf_node(state, rng)
    for _ in range(20):
        if uniform(rng) < 1.0 + ALSO_GOOD - state.iou[leaf]:
            break
        leaf = leaf_node(state, rng)
    return leaf


@njit(cache=True)
def partner(state, node, rng, leaves_only):  # type: ignore[no-untyped-def]
    """Draw another node, the more readily the closer its wanted volume is to that of `node`."""
    for _ in range(20):
        other = leaf_node(state, rng) if leaves_only else below(rng, len(state.left))
        if other == node:
            continue
        unlike = abs(np.log(state.wanted[other] / state.wanted[node])) / SIMILAR
        if uniform(rng) < 1.0 / (1.0 + unlike * unlike):
            return other
    return NONE


@njit(cache=True)
def common_ancestor(state, a, b):  # type: ignore[no-untyped-def]
    """The lowest node above both; `NONE` if they belong to different fragments."""
    node = a
    while node != NONE:
        other = b
        while other != NONE:
            if other == node:
                return node
            other = state.parent[other]
        node = state.parent[node]
    return NONE


@njit(cache=True)
def mark_below(state, scratch, top, redo):  # type: ignore[no-untyped-def]
    """Note for every inner node at or below `top` what happens to its plane."""
    for i in range(list_below(state, scratch, top)):
        node = scratch.stack[i]
        if state.left[node] != NONE:
            scratch.redo[node] = redo


@njit(cache=True)
def cut_at(scratch, node):  # type: ignore[no-untyped-def]
    """Ask for cutting again below one node."""
    scratch.tops[0] = node
    return 1


@njit(cache=True)
def shift_all(state, targets, scratch, a, b):  # type: ignore[no-untyped-def]
    """Ask for shifting all planes below the common ancestor of two nodes, or below both roots."""
    add_up_wanted(state, targets.volumes)
    node = common_ancestor(state, a, b)
    if node != NONE:
        mark_below(state, scratch, node, SHIFT)
        return cut_at(scratch, node)
    for i, root in enumerate((state.root[a], state.root[b])):
        mark_below(state, scratch, root, SHIFT)
        scratch.tops[i] = root
    return 2
