"""Cutting virtually again below the nodes that a move has changed, and scoring the leaves whose points changed."""

import numpy as np
from numba import njit

from cutgrammar.fitting.plan_state import (
    DRAW,
    KEEP,
    NONE,
    partition,
    points_key,
    score_leaves,
    shift_to_volumes,
)
from cutgrammar.fitting.principal_frame import principal_frame
from cutgrammar.inference.draws import below, uniform

LOOKED_AT = 200
"""About as many points give the principal axes of a node."""


@njit(cache=True)
def recut(state, targets, scratch, n_tops, needed, rng):  # type: ignore[no-untyped-def]
    """Cut again below `scratch.tops[:n_tops]`, as `scratch.redo` asks, and score; flags are reset.

    Returns:
        The sum of the IoU of all leaves, or -1 if it cannot reach `needed`, whereupon leaves remain unscored.
    """
    stack = scratch.stack
    found = 0
    for t in range(n_tops):
        stack[0], n = scratch.tops[t], 1
        while n > 0:
            n -= 1
            node = stack[n]
            if state.left[node] == NONE:
                key = points_key(state, node)
                if key != state.key[node]:
                    state.key[node] = key
                    scratch.leaves[found] = node
                    found += 1
                continue
            if scratch.redo[node] != KEEP:
                if scratch.redo[node] == DRAW:
                    draw_normal(state, node, rng)
                shift_to_volumes(state, scratch, node)
                scratch.redo[node] = KEEP
            partition(state, scratch, node)
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2
    return score_leaves(state, targets, scratch, found, needed)


@njit(cache=True)
def draw_normal(state, node, rng):  # type: ignore[no-untyped-def]
    """A new normal for a node: that of another plane of the same fragment, or a principal axis of its points."""
    plane = state.planes[node]
    sign = 1.0 if uniform(rng) < 0.5 else -1.0
    if uniform(rng) < 0.5:
        for _ in range(4):
            other = below(rng, len(state.left))
            if state.left[other] != NONE and other != node and state.root[other] == state.root[node]:
                for axis in range(3):
                    plane[axis] = sign * state.planes[other, axis]
                return
    centre, axes, deviations = np.empty(3), np.zeros((3, 3)), np.empty(3)
    column = below(rng, 3)
    first, last = state.first[node], state.last[node]
    if last - first > 3:
        principal_frame(state.points, first, last, max((last - first) // LOOKED_AT, 1), centre, axes, deviations)
    else:
        axes[column, column] = 1.0
    for axis in range(3):
        plane[axis] = sign * axes[axis, column]
