"""Grounding the terminals of a parse tree in the goal's fragments (III-B, Eq. 9), in the paper's two steps.

First the Hungarian algorithm maximises the shape term (Eq. 5); then simulated annealing maximises the layout term
(Eq. 6) by swapping the fragments of two terminals of the same type, which leaves the shape term unchanged. A swap
changes only the sums of positions on the paths from the two terminals up to their lowest common ancestor, so only those
are recomputed.
"""

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.draws import Compiled, State, below, uniform
from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.posterior import UNGROUNDED

START_TEMPERATURE, END_TEMPERATURE = 1.0, 0.01
"""Temperatures of the annealing, relative to the initial mean distance between a node and its parent."""


def assign(types: Ints, log_goal: Floats) -> Ints:
    """The assignment that maximises the shape term, Eq. (5): step (i) of the grounding.

    Args:
        types: (t,) types of the terminals.
        log_goal: (g, k) log p(z|c) of the goal's fragments.

    Returns:
        (t,) the fragment of every terminal; `UNGROUNDED` for terminals without a fragment, which exist if t > g.
        Terminals of one type get their fragments in ascending order, so the result depends on the types alone.
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
    tree: ParseTree, grounding: Ints, p_WG: Floats, layout_length_scale: float, n_swaps: int, state: State
) -> tuple[Ints, float]:
    """Anneal the layout term, Eq. (6), and return the best grounding found: step (ii) of the grounding.

    Args:
        tree: the parse tree.
        grounding: (t,) the initial grounding; terminals of one type may swap their fragments.
        p_WG: (g, 3) centroids of the goal's fragments in W [m].
        layout_length_scale: length scale of Eq. (7) [m].
        n_swaps: number of swaps to try.
        state: random stream of `draws`.

    Returns:
        The best grounding (t,) and its log layout term.
    """
    best = grounding.copy()
    distance = _anneal(tree.types, tree.parents, tree.terminals, best, p_WG, n_swaps, state)
    return best, -distance / layout_length_scale


@njit(cache=True)
def _anneal(
    types: Compiled,
    parents: Compiled,
    terminals: Compiled,
    best: Compiled,
    positions: Compiled,
    n_swaps: int,
    state: Compiled,
) -> float:
    """Anneal `best` in place; return the summed distance of all nodes but the roots from their parents [m]."""
    n = len(parents)
    links = tree_links(parents)
    sums, spread = np.zeros((n, 3)), np.zeros(n)
    totals = sums, np.zeros(n, np.int64)
    best_energy: float = _measure(parents, links, terminals, best, positions, totals, spread)
    order, start, size = _by_type(types[terminals])
    swappable = np.flatnonzero(size > 1)
    if len(swappable) == 0 or best_energy == 0.0 or n_swaps == 0:
        return best_energy

    current = best.copy()
    energy = best_energy
    temperature = START_TEMPERATURE * best_energy / np.sum(parents >= 0)
    cooling = (END_TEMPERATURE / START_TEMPERATURE) ** (1.0 / n_swaps)
    changed, old_spread = np.empty(n, np.int64), np.empty(n)
    for _ in range(n_swaps):
        temperature *= cooling
        first = swappable[below(state, len(swappable))]
        second = start[first] + below(state, size[first] - 1)
        second += second >= first
        i, j = order[first], order[second]
        a, b = terminals[i], terminals[j]
        if parents[a] == parents[b] or current[i] < 0 or current[j] < 0:
            continue
        x = positions[current[j], 0] - positions[current[i], 0]
        y = positions[current[j], 1] - positions[current[i], 1]
        z = positions[current[j], 2] - positions[current[i], 2]
        _move(a, b, x, y, z, parents, sums)
        gain, touched = 0.0, 0
        a, b = parents[a], parents[b]
        while a >= 0 or b >= 0:
            node = max(a, b)
            changed[touched], old_spread[touched] = node, spread[node]
            spread[node] = node_spread(node, links, totals)
            gain += old_spread[touched] - spread[node]
            touched += 1
            if a == b:
                break  # nothing changes above the common ancestor
            if a > b:
                a = parents[a]
            else:
                b = parents[b]
        if gain >= 0.0 or uniform(state) < np.exp(gain / temperature):
            current[i], current[j] = current[j], current[i]
            energy -= gain
            if energy < best_energy * (1.0 - 1e-12):
                best_energy = energy
                best[:] = current
        else:
            _move(terminals[i], terminals[j], -x, -y, -z, parents, sums)
            for s in range(touched):
                spread[changed[s]] = old_spread[s]
    return float(_measure(parents, links, terminals, best, positions, totals, spread))


@njit(cache=True)
def tree_links(parents: Compiled) -> Compiled:
    """(n,), (n,): every node's first child and its next sibling, or -1."""
    first_child, next_sibling = np.full(len(parents), -1), np.full(len(parents), -1)
    for node in range(len(parents) - 1, -1, -1):
        if parents[node] >= 0:
            next_sibling[node] = first_child[parents[node]]
            first_child[parents[node]] = node
    return first_child, next_sibling


@njit(cache=True)
def _by_type(types: Compiled) -> Compiled:
    """Terminals sorted by type: (t,) their order; for each position (t,) its type's first position and (t,) count."""
    order = np.argsort(types, kind="mergesort")
    start, size = np.zeros(len(types), np.int64), np.zeros(len(types), np.int64)
    for i in range(len(types)):
        start[i] = start[i - 1] if i > 0 and types[order[i]] == types[order[i - 1]] else i
        size[start[i]] += 1
    return order, start, size[start]


@njit(cache=True)
def _measure(
    parents: Compiled,
    links: Compiled,
    terminals: Compiled,
    grounding: Compiled,
    positions: Compiled,
    totals: Compiled,
    spread: Compiled,
) -> float:
    """Recompute `totals` (sums and numbers of positions) and `spread` of all nodes; return the total spread [m]."""
    sums, counts = totals
    sums[:] = 0.0
    counts[:] = 0
    for t in range(len(terminals)):
        if grounding[t] >= 0:
            sums[terminals[t]] = positions[grounding[t]]
            counts[terminals[t]] = 1
    for node in range(len(parents) - 1, -1, -1):
        if parents[node] >= 0:
            sums[parents[node]] += sums[node]
            counts[parents[node]] += counts[node]
    for node in range(len(parents)):
        spread[node] = node_spread(node, links, totals)
    return float(np.sum(spread))


@njit(cache=True)
def node_spread(node: int, links: Compiled, totals: Compiled) -> float:
    """Summed distance of a node's grounded children from its centre [m]."""
    first_child, next_sibling = links
    sums, counts = totals
    total = 0.0
    child = first_child[node]
    while child >= 0:
        if counts[child] > 0:
            x = sums[child, 0] / counts[child] - sums[node, 0] / counts[node]
            y = sums[child, 1] / counts[child] - sums[node, 1] / counts[node]
            z = sums[child, 2] / counts[child] - sums[node, 2] / counts[node]
            total += np.sqrt(x * x + y * y + z * z)
        child = next_sibling[child]
    return total


@njit(cache=True)
def _move(a: int, b: int, x: float, y: float, z: float, parents: Compiled, sums: Compiled) -> None:
    """Add (x, y, z) to the sums on the path up from a, and subtract it on that from b, below their common ancestor."""
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
