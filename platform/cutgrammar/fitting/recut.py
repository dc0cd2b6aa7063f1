"""Cutting virtually again below the nodes that a move has changed, and scoring the leaves whose points changed."""

import numpy as np
from numba import njit

from cutgrammar.fitting.plan_state import (
    DRAW,
    KEEP,
    NONE,
    list_below,
    measure,
    most_iou,
    partition,
    points_key,
    score_leaves,
    shift_to_volumes,
    total_iou,
)
from cutgrammar.fitting.principal_frame import moments, principal_axes
from cutgrammar.inference.draws import below, uniform

LOOKED_AT = 200
"""About as many points give the principal axes of a node."""


@njit(cache=True)
def recut(state, targets, scratch, n_tops, needed, rng):  # type: ignore[no-untyped-def]
    """Cut again below `scratch.tops[:n_tops]`, as `scratch.redo` asks, and score; flags are reset.

    It stops as soon as the leaves that were reached leave no hope.

    Returns:
        The sum of the IoU of all leaves, or -1 if it cannot reach `needed`, whereupon leaves remain unscored.
    """
    stack = scratch.stack
    found = 0
    bound = _most_hoped_for(state, scratch, n_tops)
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
                    state.iou[node] = 0.0
                    if measure(state, scratch, node):
                        state.iou[node] = most_iou(state, targets, scratch, node, state.goal[node])
                bound += state.iou[node] - 1.0
                if bound < needed:
                    scratch.redo[:] = KEEP
                    return -1.0
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
def _most_hoped_for(state, scratch, n_tops):  # type: ignore[no-untyped-def]
    """Sum of the IoU of all leaves if those below `scratch.tops[:n_tops]` fitted perfectly."""
    total = total_iou(state)
    for t in range(n_tops):
        for i in range(list_below(state, scratch, scratch.tops[t])):
            node = scratch.stack[i]
            if state.left[node] == NONE:
                total += 1.0 - state.iou[node]
    return total


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
    centre, covariance, axes = np.empty(3), np.empty((3, 3)), np.zeros((3, 3))
    column = below(rng, 3)
    first, last = state.first[node], state.last[node]
    if last - first > 3:
        few = np.asfortranarray(state.points[first : last : max((last - first) // LOOKED_AT, 1)])
        moments(few, 0, len(few), centre, covariance)
        principal_axes(covariance, axes)
    else:
        axes[column, column] = 1.0
    for axis in range(3):
        plane[axis] = sign * axes[axis, column]
