"""Grounding with attributes: annealing of all terms that depend on which fragment each terminal gets.

Where the paper first maximises the shape term and then swaps within types for the layout term (`grounding`), here the
energy is the sum of the layout term (if the goal has a layout), the volume term of all nodes and, where terminals of
different types may swap, the shape term, in nats. A swap changes the sums of positions and volumes on the paths from
the two terminals to their lowest common ancestor, so only the terms of these nodes are computed again.
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Ints
from cutgrammar.inference.attributes import log_of_volume
from cutgrammar.inference.draws import Compiled, State, below, uniform
from cutgrammar.inference.grounding import node_spread, tree_links
from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.problem import Problem

START_TEMPERATURE, END_TEMPERATURE = 2.0, 0.02
"""Temperatures of the annealing [nats]."""


def anneal_attributes(
    tree: ParseTree, grounding: Ints, problem: Problem, n_swaps: int, state: State
) -> tuple[Ints, float]:
    """Anneal all terms that depend on the grounding, and return the best grounding found with their sum.

    Args:
        tree: the parse tree.
        grounding: (t,) the initial grounding.
        problem: the goal, the current fragments and their attributes.
        n_swaps: number of swaps to try.
        state: random stream of `draws`.

    Raises:
        ValueError: the problem has no attributes.
    """
    attributes = problem.attributes
    if attributes is None:
        raise ValueError("the problem has no attributes to anneal")
    best = grounding.copy()
    _, total = anneal_in_place(
        tree.types,
        tree.parents,
        tree.terminals,
        best,
        (problem.p_WG, attributes.goal_volumes, problem.log_goal),
        1.0 / problem.layout_length_scale if attributes.layout else 0.0,
        attributes.compiled,
        attributes.swap_types,
        n_swaps,
        state,
    )
    return best, total


@njit(cache=True)
def anneal_in_place(
    types: Compiled,
    parents: Compiled,
    terminals: Compiled,
    best: Compiled,
    goal: Compiled,
    layout_weight: float,
    volumes_expected: Compiled,
    swap_types: bool,
    n_swaps: int,
    state: Compiled,
) -> tuple[float, float]:
    """Anneal `best` in place.

    Returns:
        By how much the sum of its terms exceeds that of the initial grounding, from the increments of the swaps; and
        that sum, computed anew [nats].
    """
    positions, goal_volumes, log_goal = goal
    n, t = len(parents), len(terminals)
    links = tree_links(parents)
    totals = np.zeros((n, 3)), np.zeros(n, np.int64), np.zeros(n)
    sums, counts, volumes = totals
    roots, terms = np.full(n, -1), np.empty(n)
    fragment = 0
    for node in range(n):
        if parents[node] < 0:
            roots[node] = fragment
            fragment += 1
    first = _measure(
        types, parents, terminals, links, roots, best, goal, layout_weight, volumes_expected, totals, terms
    )
    if t < 2 or n_swaps == 0:
        return 0.0, first
    current = best.copy()
    score, best_score = 0.0, 0.0
    temperature = START_TEMPERATURE
    cooling = (END_TEMPERATURE / START_TEMPERATURE) ** (1.0 / n_swaps)
    changed, old_terms = np.empty(n, np.int64), np.empty(n)
    for _ in range(n_swaps):
        temperature *= cooling
        i = below(state, t)
        j = below(state, t - 1)
        j += j >= i
        a, b = terminals[i], terminals[j]
        same = types[a] == types[b]
        if current[i] < 0 or current[j] < 0 or not (swap_types or same) or (same and parents[a] == parents[b]):
            continue
        f, g = current[i], current[j]
        gain = 0.0
        if not same:
            gain += log_goal[g, types[a]] + log_goal[f, types[b]] - log_goal[f, types[a]] - log_goal[g, types[b]]
        x = positions[g, 0] - positions[f, 0]
        y = positions[g, 1] - positions[f, 1]
        z = positions[g, 2] - positions[f, 2]
        more = goal_volumes[g] - goal_volumes[f]
        _move(a, b, x, y, z, more, parents, sums, volumes)
        touched = 0
        while True:
            node = max(a, b)
            changed[touched], old_terms[touched] = node, terms[node]
            terms[node] = log_of_volume(volumes[node], types[node], roots[node], volumes_expected)
            if layout_weight > 0.0:
                terms[node] -= layout_weight * node_spread(node, links, (sums, counts))
            gain += terms[node] - old_terms[touched]
            touched += 1
            if a == b:
                break  # nothing changes above the common ancestor
            if a > b:
                a = parents[a]
            else:
                b = parents[b]
            if a < 0 and b < 0:
                break
        if gain >= 0.0 or uniform(state) < np.exp(gain / temperature):
            current[i], current[j] = g, f
            score += gain
            if score > best_score + 1e-9:
                best_score = score
                best[:] = current
        else:
            _move(terminals[i], terminals[j], -x, -y, -z, -more, parents, sums, volumes)
            for s in range(touched):
                terms[changed[s]] = old_terms[s]
    total = _measure(
        types, parents, terminals, links, roots, best, goal, layout_weight, volumes_expected, totals, terms
    )
    return best_score, total


@njit(cache=True)
def _measure(
    types: Compiled,
    parents: Compiled,
    terminals: Compiled,
    links: Compiled,
    roots: Compiled,
    grounding: Compiled,
    goal: Compiled,
    layout_weight: float,
    volumes_expected: Compiled,
    totals: Compiled,
    terms: Compiled,
) -> float:
    """Recompute `totals` (sums and numbers of positions, volumes) and `terms` of all nodes; return all terms' sum."""
    positions, goal_volumes, log_goal = goal
    sums, counts, volumes = totals
    n = len(parents)
    sums[:] = 0.0
    counts[:] = 0
    volumes[:] = 0.0
    total = 0.0
    for i in range(len(terminals)):
        node = terminals[i]
        if grounding[i] >= 0:
            sums[node] = positions[grounding[i]]
            counts[node] = 1
            volumes[node] = goal_volumes[grounding[i]]
            total += log_goal[grounding[i], types[node]]
    for node in range(n - 1, -1, -1):
        if parents[node] >= 0:
            sums[parents[node]] += sums[node]
            counts[parents[node]] += counts[node]
            volumes[parents[node]] += volumes[node]
    for node in range(n):
        terms[node] = log_of_volume(volumes[node], types[node], roots[node], volumes_expected)
        if layout_weight > 0.0:
            terms[node] -= layout_weight * node_spread(node, links, (sums, counts))
        total += terms[node]
    return total


@njit(cache=True)
def _move(
    a: int, b: int, x: float, y: float, z: float, more: float, parents: Compiled, sums: Compiled, volumes: Compiled
) -> None:
    """Add a step and a volume on the path up from a, and subtract them on that from b, below their common ancestor."""
    while a != b:
        if a > b:
            sums[a, 0] += x
            sums[a, 1] += y
            sums[a, 2] += z
            volumes[a] += more
            a = parents[a]
        else:
            sums[b, 0] -= x
            sums[b, 1] -= y
            sums[b, 2] -= z
            volumes[b] -= more
            b = parents[b]
