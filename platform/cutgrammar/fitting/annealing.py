"""Simulated annealing of a plan by `plane_moves` and `structure_moves`.

Every rejected move is undone, and the best plan is kept.
"""

import numpy as np
from numba import njit

from cutgrammar.fitting.plan_state import total_iou
from cutgrammar.fitting.plane_moves import align_plane, move_plane, regrow, swap_goals
from cutgrammar.fitting.recut import recut
from cutgrammar.fitting.structure_moves import mirror, rotate, swap_subtrees, transplant, transpose
from cutgrammar.inference.draws import uniform


@njit(cache=True)
def copy_plan(source, target):  # type: ignore[no-untyped-def]
    """Copy a plan, with the order of its points, into another of the same size."""
    copy_nodes(source, target)
    copy_points(source, target, 0, len(source.points))


@njit(cache=True)
def copy_nodes(source, target):  # type: ignore[no-untyped-def]
    """Copy all of a plan but its points."""
    for node in range(len(source.left)):
        target.left[node], target.right[node] = source.left[node], source.right[node]
        target.parent[node], target.root[node] = source.parent[node], source.root[node]
        target.goal[node], target.wanted[node] = source.goal[node], source.wanted[node]
        target.first[node], target.last[node] = source.first[node], source.last[node]
        target.key[node], target.iou[node] = source.key[node], source.iou[node]
        for axis in range(4):
            target.planes[node, axis] = source.planes[node, axis]


@njit(cache=True)
def copy_points(source, target, first, last):  # type: ignore[no-untyped-def]
    """Copy the points from `first` to `last`."""
    old, new, old_keys, new_keys = source.points, target.points, source.keys, target.keys
    for i in range(first, last):
        new_keys[np.uint64(i)] = old_keys[np.uint64(i)]
    for axis in range(3):
        for i in range(first, last):
            new[np.uint64(i), axis] = old[np.uint64(i), axis]


@njit(cache=True)
def change(state, targets, scratch, rng, restructuring, kinds):  # type: ignore[no-untyped-def]
    """Make a random move; return the number of nodes to cut again below and the kind of the move."""
    kind = uniform(rng)
    if kind >= restructuring:
        return move_plane(state, scratch, rng), 0
    kind /= restructuring
    if kind < kinds[0]:
        return align_plane(state, scratch, rng), 1
    if kind < kinds[1]:
        return swap_goals(state, targets, scratch, rng), 2
    if kind < kinds[2]:
        return swap_subtrees(state, targets, scratch, rng), 3
    if kind < kinds[3]:
        return mirror(state, scratch, rng), 4
    if kind < kinds[4]:
        return rotate(state, targets, scratch, rng), 5
    if kind < kinds[5]:
        return transplant(state, targets, scratch, rng), 6
    if kind < kinds[6]:
        return transpose(state, targets, scratch, rng), 7
    return regrow(state, targets, scratch, rng), 8


@njit(cache=True)
def anneal(  # type: ignore[no-untyped-def]
    state, backup, best, targets, scratch, rng, n_moves, hot, cold, restructuring, kinds, counts
):
    """Try `n_moves` moves while the temperature falls from `hot` to `cold` (sums of IoU); return the best sum.

    Args:
        state: the plan, changed in place.
        backup: another plan of the same size, which becomes equal to `state`.
        best: the best plan so far, updated in place.
        targets: of the goal.
        scratch: working memory.
        rng: state of a compiled random stream.
        n_moves: number of moves.
        hot, cold: first and last temperature.
        restructuring: share of moves that change the structure or the grounding.
        kinds: (7,) cumulative shares of their kinds but the last.
        counts: (9, 2) numbers of moves tried and kept by kind, added to.
    """
    copy_plan(state, backup)
    score = total_iou(state)
    highest = total_iou(best)
    cooling = (cold / hot) ** (1.0 / max(n_moves, 1))
    temperature = hot
    for _ in range(n_moves):
        temperature *= cooling
        n_tops, kind = change(state, targets, scratch, rng, restructuring, kinds)
        counts[kind, 0] += 1
        if n_tops == 0:
            continue
        needed = score + temperature * np.log(1.0 - uniform(rng))
        new = recut(state, targets, scratch, n_tops, needed, rng)
        if new >= 0.0 and new >= needed:
            counts[kind, 1] += new != score
            score = new
            copy_nodes(state, backup)
            for t in range(n_tops):
                top = scratch.tops[t]
                copy_points(state, backup, state.first[top], state.last[top])
            if score > highest:
                highest = score
                copy_plan(state, best)
        else:
            _undo(backup, state, scratch.tops[0], scratch.tops[n_tops - 1])
    return highest


@njit(cache=True)
def _undo(source, state, one, other):  # type: ignore[no-untyped-def]
    """Copy a plan back whose points differ at most below two nodes."""
    copy_points(source, state, state.first[one], state.last[one])
    if other != one:
        copy_points(source, state, state.first[other], state.last[other])
    copy_nodes(source, state)
