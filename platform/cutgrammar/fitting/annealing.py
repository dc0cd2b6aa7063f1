"""Simulated annealing of a plan by the moves of `moves`: every rejected move is undone, and the best plan is kept."""

import numpy as np
from numba import njit

from cutgrammar.fitting.moves import (
    align_plane,
    mirror,
    move_plane,
    regrow,
    rotate,
    swap_goals,
    swap_subtrees,
    transplant,
)
from cutgrammar.fitting.plan_state import NONE, total_iou
from cutgrammar.inference.draws import uniform


@njit(cache=True)
def copy_plan(source, target):  # type: ignore[no-untyped-def]
    """Copy a plan, with the order of its points, into another of the same size."""
    copy_range(source, target, 0, len(source.points))


@njit(cache=True)
def copy_range(source, target, first, last):  # type: ignore[no-untyped-def]
    """Copy all of a plan, but of its points only those from `first` to `last`."""
    for node in range(len(source.left)):
        target.left[node], target.right[node], target.parent[node] = (
            source.left[node],
            source.right[node],
            source.parent[node],
        )
        target.root[node], target.goal[node], target.wanted[node] = (
            source.root[node],
            source.goal[node],
            source.wanted[node],
        )
        target.first[node], target.last[node] = source.first[node], source.last[node]
        target.key[node], target.iou[node] = source.key[node], source.iou[node]
        for axis in range(4):
            target.planes[node, axis] = source.planes[node, axis]
    for i in range(first, last):
        target.points[i, 0], target.points[i, 1], target.points[i, 2] = (
            source.points[i, 0],
            source.points[i, 1],
            source.points[i, 2],
        )
        target.keys[i] = source.keys[i]


@njit(cache=True)
def anneal(state, backup, best, targets, scratch, rng, n_moves, hot, cold, restructuring, counts):  # type: ignore[no-untyped-def]
    """Try `n_moves` moves while the temperature falls from `hot` to `cold` (sums of IoU); return the best sum.

    Args:
        state: the plan, changed in place.
        backup: another plan of the same size, equal to `state` but for the order of points.
        best: the best plan so far, updated in place.
        targets: of the goal.
        scratch: working memory.
        rng: state of a compiled random stream.
        n_moves: number of moves.
        hot, cold: first and last temperature.
        restructuring: share of moves that change the structure or the grounding.
        counts: (8, 2) numbers of moves tried and kept by kind, added to.
    """
    copy_plan(state, backup)
    score = total_iou(state)
    highest = total_iou(best)
    cooling = (cold / hot) ** (1.0 / max(n_moves, 1))
    temperature = hot
    for _ in range(n_moves):
        temperature *= cooling
        kind = uniform(rng)
        if kind >= restructuring:
            which = 0
            top = move_plane(state, targets, scratch, rng)
        else:
            kind /= restructuring
            if kind < 0.15:
                which = 1
                top = align_plane(state, targets, scratch, rng)
            elif kind < 0.45:
                which = 2
                top = swap_goals(state, targets, scratch, rng)
            elif kind < 0.6:
                which = 3
                top = swap_subtrees(state, targets, scratch, rng)
            elif kind < 0.65:
                which = 4
                top = mirror(state, targets, scratch, rng)
            elif kind < 0.72:
                which = 5
                top = rotate(state, targets, scratch, rng)
            elif kind < 0.9:
                which = 6
                top = transplant(state, targets, scratch, rng)
            else:
                which = 7
                top = regrow(state, targets, scratch, rng)
        counts[which, 0] += 1
        new = total_iou(state)
        first, last = 0, len(state.points)
        if 0 <= top < len(state.left):
            first, last = state.first[top], state.last[top]
        if top != NONE and (new >= score or uniform(rng) < np.exp((new - score) / temperature)):
            counts[which, 1] += new != score
            score = new
            copy_range(state, backup, first, last)
            if score > highest:
                highest = score
                copy_plan(state, best)
        else:
            copy_range(backup, state, first, last)
    return highest
