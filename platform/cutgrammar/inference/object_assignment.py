"""Which of the goal's fragments are to come out of which current fragment.

Eq. (3) factorises over the current fragments once every goal fragment belongs to one of them. An assignment is drawn by
annealing the energy

    sum over current fragments i of   ((log V_i - log V(G_i)) / conservation)^2 / 2
                                    - log sum over c of p(c | z_i) m(c, |G_i|)
                                    - sum over g in G_i of log sum over c of t(c | i) p(z_g | c)
                                    + summed distances of the fragments in G_i from their centre / layout length scale

with moves of one fragment and swaps of two. V(G_i) is the summed volume of the fragments G_i assigned to i, and m(c, n)
the mass of the parse trees by which type c derives n terminals (`reachable`). t(c | i) is the share of type c among the
terminals of rollouts for fragment i alone, with its share of the goal's number of fragments, and p(c | z_i) where i is
to stay whole. The last line counts only where the goal has a layout.
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.draws import Compiled, State, below, uniform
from cutgrammar.inference.parse_tree import PartialParseTree
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import Derivations
from cutgrammar.inference.rollout import roll_out

START_TEMPERATURE, END_TEMPERATURE = 10.0, 0.05
"""Temperatures of the annealing [nats]."""
MOVES_PER_FRAGMENT = 400
"""Moves for each of the goal's fragments."""
ROLLOUTS = 20
"""Rollouts for each current fragment, from which the types of its terminals are estimated."""
SMOOTHING = 0.1
"""Weight of the uniform distribution in that estimate."""
IMPOSSIBLE = 50.0
"""Energy of a number of terminals that no possible type derives [nats]."""


def assign_objects(problem: Problem, derived: Derivations, possible: Floats, state: State) -> Ints:
    """(g,) the current fragment that each of the goal's fragments is to come out of; every one gets at least one.

    Args:
        problem: the goal and the current fragments, of which there are at most as many as in the goal.
        derived: derivations of the grammar, for at least as many terminals as the goal has fragments.
        possible: (m, k) p(c|z) of the current fragments, zero for impossible types.
        state: random stream of `draws`.

    Raises:
        ValueError: the problem has no attributes.
    """
    attributes = problem.attributes
    if attributes is None:
        raise ValueError("fragments are assigned by their volumes, but the problem has no attributes")
    g = len(problem.log_goal)
    with np.errstate(divide="ignore"):
        counts = -np.log(possible @ derived.mass[:, : g + 1])
        relative = np.exp(problem.log_goal - problem.log_goal.max(axis=1, keepdims=True)).T
        alone = -np.log(possible @ relative)
        fits = -np.log(_terminal_shares(attributes.current_volumes, g, derived, possible, state) @ relative)
    sigma = attributes.conservation if attributes.conservation > 0.0 else 1e6
    assigned = _initial(attributes.goal_volumes, attributes.current_volumes)
    _anneal(
        assigned,
        np.minimum(counts, IMPOSSIBLE),
        np.minimum(alone, IMPOSSIBLE),
        np.minimum(fits, IMPOSSIBLE),
        (attributes.goal_volumes, np.log(attributes.current_volumes), sigma),
        (problem.p_WG, 1.0 / problem.layout_length_scale if attributes.layout else 0.0),
        MOVES_PER_FRAGMENT * g,
        state,
    )
    return assigned


def _terminal_shares(volumes: Floats, g: int, derived: Derivations, possible: Floats, state: State) -> Floats:
    """(m, k) share of each type among the terminals of rollouts for each current fragment alone, smoothed."""
    m, k = possible.shape
    shares = np.full((m, k), SMOOTHING / k)
    for i in range(m):
        n = int(np.clip(round(g * volumes[i] / volumes.sum()), 2, g))
        weights = possible[i] * derived.mass[:, n]
        if weights.sum() <= 0.0:
            continue
        below_types = np.cumsum(weights / weights.sum())
        for _ in range(ROLLOUTS):
            c = min(int(np.searchsorted(below_types, uniform(state), side="right")), k - 1)
            tree = roll_out(derived, PartialParseTree.of((c,), n), state)
            shares[i] += np.bincount(tree.types[tree.terminals], minlength=k) / (n * ROLLOUTS)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def _initial(goal: Floats, current: Floats) -> Ints:
    """Largest first, each to where most volume is left, and one to every current fragment."""
    left = current.copy()
    assigned = np.zeros(len(goal), dtype=np.int64)
    order = np.argsort(-goal, kind="stable")
    for position, g in enumerate(order):
        empty = np.setdiff1d(np.arange(len(current)), assigned[order[:position]])
        options = empty if len(empty) == len(order) - position else np.arange(len(current))
        assigned[g] = options[np.argmax(left[options])]
        left[assigned[g]] -= goal[g]
    return assigned


@njit(cache=True)
def _group_energy(
    i: int, assigned: Compiled, counts: Compiled, alone: Compiled, fits: Compiled, volumes: Compiled, places: Compiled
) -> float:
    """The terms of one current fragment."""
    goal_volumes, log_current, sigma = volumes
    positions, layout_weight = places
    n, last, volume = 0, -1, 0.0
    x, y, z, fit = 0.0, 0.0, 0.0, 0.0
    for g in range(len(assigned)):
        if assigned[g] == i:
            n += 1
            last = g
            volume += goal_volumes[g]
            fit += fits[i, g]
            x += positions[g, 0]
            y += positions[g, 1]
            z += positions[g, 2]
    energy: float = counts[i, n] + 0.5 * ((np.log(volume) - log_current[i]) / sigma) ** 2
    energy += alone[i, last] if n == 1 else fit
    if layout_weight > 0.0:
        for g in range(len(assigned)):
            if assigned[g] == i:
                dx, dy, dz = positions[g, 0] - x / n, positions[g, 1] - y / n, positions[g, 2] - z / n
                energy += layout_weight * np.sqrt(dx * dx + dy * dy + dz * dz)
    return energy


@njit(cache=True)
def _anneal(
    assigned: Compiled,
    counts: Compiled,
    alone: Compiled,
    fits: Compiled,
    volumes: Compiled,
    places: Compiled,
    n_moves: int,
    state: Compiled,
) -> float:
    """Anneal `assigned` in place to the best assignment found; return its energy."""
    g, m = len(assigned), len(counts)
    energies, sizes = np.empty(m), np.zeros(m, np.int64)
    for f in range(g):
        sizes[assigned[f]] += 1
    for i in range(m):
        energies[i] = _group_energy(i, assigned, counts, alone, fits, volumes, places)
    energy = np.sum(energies)
    best, best_energy = assigned.copy(), energy
    if m < 2:
        return float(energy)
    temperature = START_TEMPERATURE
    cooling = (END_TEMPERATURE / START_TEMPERATURE) ** (1.0 / n_moves)
    for _ in range(n_moves):
        temperature *= cooling
        f = below(state, g)
        i, other = assigned[f], -1
        if uniform(state) < 0.5:
            j = below(state, m - 1)
            j += j >= i
            if sizes[i] == 1:
                continue
        else:
            other = below(state, g)
            j = assigned[other]
            if i == j:
                continue
            assigned[other] = i
        assigned[f] = j
        old = energies[i] + energies[j]
        first = _group_energy(i, assigned, counts, alone, fits, volumes, places)
        second = _group_energy(j, assigned, counts, alone, fits, volumes, places)
        gain = old - first - second
        if gain >= 0.0 or uniform(state) < np.exp(gain / temperature):
            energies[i], energies[j] = first, second
            if other < 0:
                sizes[i] -= 1
                sizes[j] += 1
            energy -= gain
            if energy < best_energy - 1e-9:
                best_energy = energy
                best[:] = assigned
        else:
            assigned[f] = i
            if other >= 0:
                assigned[other] = j
    assigned[:] = best
    return float(best_energy)
