"""Grounding the terminals of a parse tree in the goal's fragments (III-B, Eq. 9), in the paper's two steps.

First the Hungarian algorithm maximises the shape term (Eq. 5); then simulated annealing maximises the layout term
(Eq. 6) by swapping the fragments of two terminals of the same type, which leaves the shape term as it is. A swap
changes the sums of positions on the two paths up to where they meet, so only those are computed anew.
"""

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.draws import Compiled, State, below, uniform
from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.posterior import UNGROUNDED

HOTTEST, COLDEST = 1.0, 0.01
"""Temperatures of the annealing, relative to the mean distance between a node and its parent at its start."""


def assign(types: Ints, log_goal: Floats) -> Ints:
    """The assignment that maximises the shape term, Eq. (5): step (i) of the grounding.

    Args:
        types: (t,) types of the terminals.
        log_goal: (g, k) log p(z|c) of the goal's fragments.

    Returns:
        (t,) the fragment of every terminal, `UNGROUNDED` for those left over where t > g. Among terminals of one type
        the fragments come in their order, so that it depends on the types alone which type a fragment gets.
    """
    order = np.argsort(types, kind="stable")
    rows, columns = linear_sum_assignment(log_goal[:, types[order]].T, maximize=True)
    found = np.full(len(types), UNGROUNDED, dtype=np.int64)
    found[rows] = columns
    sorted_types = types[order]
    within = np.lexsort((np.where(found == UNGROUNDED, len(log_goal), found), sorted_types))
    grounding = np.empty_like(found)
    grounding[order] = found[within]
    return grounding


def anneal(
    tree: ParseTree,
    grounding: Ints,
    p_WG: Floats,
    layout_length_scale: float,
    swaps: int,
    state: State,
) -> tuple[Ints, float]:
    """The best grounding met while annealing the layout term, Eq. (6): step (ii) of the grounding.

    Args:
        tree: the parse tree.
        grounding: (t,) where to start; terminals of one type may swap their fragments.
        p_WG: (g, 3) centroids of the goal's fragments in W [m].
        layout_length_scale: of Eq. (7) [m].
        swaps: number of swaps tried.
        state: stream of `draws`.

    Returns:
        The grounding (t,) and its log layout term.
    """
    best = grounding.copy()
    distance = _anneal(tree.types, tree.parents, tree.terminals, best, p_WG, swaps, state)
    return best, -distance / layout_length_scale


@njit(cache=True)
def _anneal(
    types: Compiled,
    parents: Compiled,
    terminals: Compiled,
    best: Compiled,
    places: Compiled,
    swaps: int,
    state: Compiled,
) -> float:
    """Anneal `best` in place; the distance [m] of the nodes from their parents, summed over all but v_S's children."""
    n = len(parents)
    eldest, younger = _families(parents)
    sums, counts, spread = np.zeros((n, 3)), np.zeros(n, np.int64), np.zeros(n)
    least: float = _measure(parents, eldest, younger, terminals, best, places, sums, counts, spread)
    order, start, size = _by_type(types[terminals])
    free = np.flatnonzero(size > 1)
    if len(free) == 0 or least == 0.0 or swaps == 0:
        return least

    now = best.copy()
    energy = least
    temperature = HOTTEST * least / np.sum(parents >= 0)
    cooling = (COLDEST / HOTTEST) ** (1.0 / swaps)
    changed, before = np.empty(n, np.int64), np.empty(n)
    for _ in range(swaps):
        temperature *= cooling
        one = free[below(state, len(free))]
        two = start[one] + below(state, size[one] - 1)
        two += two >= one
        i, j = order[one], order[two]
        a, b = terminals[i], terminals[j]
        if parents[a] == parents[b] or now[i] < 0 or now[j] < 0:
            continue
        x = places[now[j], 0] - places[now[i], 0]
        y = places[now[j], 1] - places[now[i], 1]
        z = places[now[j], 2] - places[now[i], 2]
        _move(a, b, x, y, z, parents, sums)
        gain, touched = 0.0, 0
        a, b = parents[a], parents[b]
        while a >= 0 or b >= 0:
            node = max(a, b)
            changed[touched], before[touched] = node, spread[node]
            spread[node] = _spread(node, eldest, younger, sums, counts)
            gain += before[touched] - spread[node]
            touched += 1
            if a == b:
                break  # above the node where the paths meet nothing changes
            if a > b:
                a = parents[a]
            else:
                b = parents[b]
        if gain >= 0.0 or uniform(state) < np.exp(gain / temperature):
            now[i], now[j] = now[j], now[i]
            energy -= gain
            if energy < least * (1.0 - 1e-12):
                least = energy
                best[:] = now
        else:
            _move(terminals[i], terminals[j], -x, -y, -z, parents, sums)
            for s in range(touched):
                spread[changed[s]] = before[s]
    return float(_measure(parents, eldest, younger, terminals, best, places, sums, counts, spread))


@njit(cache=True)
def _families(parents: Compiled) -> Compiled:
    """(n,), (n,): the first child of every node and its next sibling, -1 for none."""
    eldest, younger = np.full(len(parents), -1), np.full(len(parents), -1)
    for node in range(len(parents) - 1, -1, -1):
        if parents[node] >= 0:
            younger[node] = eldest[parents[node]]
            eldest[parents[node]] = node
    return eldest, younger


@njit(cache=True)
def _by_type(types: Compiled) -> Compiled:
    """(t,) order of the terminals by type; (t,), (t,) where in it each one's type begins, and its number."""
    order = np.argsort(types, kind="mergesort")
    start, size = np.zeros(len(types), np.int64), np.zeros(len(types), np.int64)
    for i in range(len(types)):
        start[i] = start[i - 1] if i > 0 and types[order[i]] == types[order[i - 1]] else i
        size[start[i]] += 1
    return order, start, size[start]


@njit(cache=True)
def _measure(
    parents: Compiled,
    eldest: Compiled,
    younger: Compiled,
    terminals: Compiled,
    grounding: Compiled,
    places: Compiled,
    sums: Compiled,
    counts: Compiled,
    spread: Compiled,
) -> float:
    """Compute sums, counts and spread of all nodes anew; the total spread."""
    sums[:] = 0.0
    counts[:] = 0
    for t in range(len(terminals)):
        if grounding[t] >= 0:
            sums[terminals[t]] = places[grounding[t]]
            counts[terminals[t]] = 1
    for node in range(len(parents) - 1, -1, -1):
        if parents[node] >= 0:
            sums[parents[node]] += sums[node]
            counts[parents[node]] += counts[node]
    for node in range(len(parents)):
        spread[node] = _spread(node, eldest, younger, sums, counts)
    return float(np.sum(spread))


@njit(cache=True)
def _spread(node: int, eldest: Compiled, younger: Compiled, sums: Compiled, counts: Compiled) -> float:
    """Distance [m] of a node's children from its centre, summed over those with fragments."""
    total = 0.0
    child = eldest[node]
    while child >= 0:
        if counts[child] > 0:
            x = sums[child, 0] / counts[child] - sums[node, 0] / counts[node]
            y = sums[child, 1] / counts[child] - sums[node, 1] / counts[node]
            z = sums[child, 2] / counts[child] - sums[node, 2] / counts[node]
            total += np.sqrt(x * x + y * y + z * z)
        child = younger[child]
    return total


@njit(cache=True)
def _move(a: int, b: int, x: float, y: float, z: float, parents: Compiled, sums: Compiled) -> None:
    """Add (x, y, z) to the sums above terminal a and take it from those above b, up to where their paths meet."""
    while a != b:
        if a > b:
            sums[a, 0] += x
            sums[a, 1] += y
            sums[a, 2] += z
            a = parents[a]
        else:
            sums[b, 0] -= x
            sums[b, 1] -= y
            sums[b, 2] -= z
            b = parents[b]
