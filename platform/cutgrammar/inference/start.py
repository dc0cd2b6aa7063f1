"""Expansions of the start symbol, H(I^t) of Eq. (8): types sampled for the current fragments.

Types are sampled from p(c|z) times the mass with which they jointly derive the target number of terminals (see
`reachable`). Types that cannot derive it only lead to dead ends, and types whose parse trees are improbable or end in
types unlike the goal's fragments waste rollouts. Only p(c|z) enters the posterior.

If no possible types derive the goal's number of fragments, the target is the nearest number that they derive. Every
parse tree is then reported as a dead end, and the plan goes as far as the grammar allows.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import MIN_MASS, Derivations


def possible_types(problem: Problem, min_probability: float) -> Floats:
    """(m, k) p(c|z) of the current fragments; probabilities below `min_probability` are set to zero."""
    shares = np.exp(problem.log_current)
    return np.asarray(np.where(shares >= min_probability, shares, 0.0))


def max_terminals(problem: Problem) -> int:
    """Upper bound of the target number of terminals; it exceeds the goal's number in case that cannot be derived."""
    widest = max((len(p.children) for p in problem.grammar.probabilities), default=2)
    return max(len(problem.log_goal), len(problem.log_current)) + widest - 1


def target_terminals(problem: Problem, derived: Derivations, possible: Floats) -> int | None:
    """The number of terminals that all parse trees of a search have.

    Args:
        problem: the goal and the current fragments.
        derived: derivations of the grammar, up to `max_terminals`.
        possible: (m, k) from `possible_types`.

    Returns:
        The goal's number of fragments if at least one cut derives it; otherwise the nearest number that can be derived
        (of two, the smaller); None if no current fragment can be cut.
    """
    goal = len(problem.log_goal)
    ways = _ways(derived, possible)[-1]
    derivable = [n for n in range(len(problem.log_current) + 1, len(ways)) if ways[n] > 0.0]
    return min(derivable, key=lambda n: (abs(n - goal), n), default=None)


def draw_types(
    derived: Derivations, possible: Floats, terminals: int, n_draws: int, rng: np.random.Generator
) -> list[tuple[int, ...]]:
    """Sample the types of the current fragments `n_draws` times; return the distinct results in the order drawn.

    Args:
        derived: derivations of the grammar.
        possible: (m, k) from `possible_types`.
        terminals: number of terminals that the types must derive together.
        n_draws: number of draws.
        rng: random stream.

    Raises:
        ValueError: no possible types derive that number.
    """
    if not _ways(derived, possible)[-1][terminals] > 0.0:
        raise ValueError(f"the current fragments cannot derive {terminals} terminals")
    ways, masses = _weighted_ways(derived, possible), possible @ derived.mass
    drawn: dict[tuple[int, ...], None] = {}
    for _ in range(n_draws):
        remaining, types = terminals, [0] * len(possible)
        for i in range(len(possible) - 1, -1, -1):
            # Fragment i gets 1 to `remaining` terminals, fragments 0 to i - 1 the others.
            share = 1 + _sample_index(masses[i, 1 : remaining + 1] * ways[i][remaining - 1 :: -1], rng)
            types[i] = _sample_index(possible[i] * derived.mass[:, share], rng)
            remaining -= share
        drawn[tuple(types)] = None
    return list(drawn)


def _sample_index(weights: Floats, rng: np.random.Generator) -> int:
    """Sample an index in proportion to weights (n,), at least one of which is positive."""
    below = np.cumsum(weights)
    return min(int(np.searchsorted(below, rng.random() * below[-1], side="right")), int(np.flatnonzero(weights)[-1]))


def _ways(derived: Derivations, possible: Floats) -> list[Floats]:
    """For i = 0 to m, (N + 1,) by n: probability that the first i fragments can derive n terminals.

    It is summed over all divisions of the n terminals among the fragments, so only its sign is meaningful.
    """
    size = derived.mass.shape[1]
    ways = [np.eye(1, size)[0]]
    for row in possible:
        extended = np.convolve(ways[-1], row @ (derived.mass > 0.0))[:size]
        ways.append(extended)
    return ways


def _weighted_ways(derived: Derivations, possible: Floats) -> list[Floats]:
    """The same, weighted with the mass of the parse trees, each row up to a factor."""
    ways = [np.eye(1, derived.mass.shape[1])[0]]
    for row in possible:
        extended = np.convolve(ways[-1], row @ derived.mass)[: derived.mass.shape[1]]
        scaled = extended / extended.max()
        ways.append(np.where(extended > 0.0, np.maximum(scaled, MIN_MASS), 0.0))
    return ways
