"""The expansions of the start symbol, H(I^t) of Eq. (8): types drawn for the current fragments.

The types are drawn from p(c|z), times the mass with which they derive the number of terminals wanted together (see
`reachable`): types that cannot derive it would only make dead ends, and those whose parse trees are improbable, or end
in types unlike the goal's fragments, would waste rollouts. What a draw costs in the posterior is p(c|z) alone.

Where no types that the current fragments can have derive the goal's number of fragments, the nearest number that they
can derive is wanted instead: every parse tree is then a dead end, which is reported as one, and the plan goes as far as
the grammar goes.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import SMALLEST, Derivations


def possible_types(problem: Problem, least: float) -> Floats:
    """(m, k) p(c|z) of the current fragments; types less probable than `least` count as impossible."""
    shares = np.exp(problem.log_current)
    return np.asarray(np.where(shares >= least, shares, 0.0))


def max_terminals(problem: Problem) -> int:
    """The greatest number of terminals that can come to be wanted: a little over the goal's, for want of it."""
    widest = max((len(p.children) for p in problem.grammar.probabilities), default=2)
    return max(len(problem.log_goal), len(problem.log_current)) + widest - 1


def target_terminals(problem: Problem, known: Derivations, possible: Floats) -> int | None:
    """The number of terminals that parse trees shall have.

    Args:
        problem: the goal and the current fragments.
        known: what the grammar derives, up to `max_terminals`.
        possible: (m, k) from `possible_types`.

    Returns:
        The goal's number of fragments if it can be derived with at least one cut; else the nearest number that can
        (the smaller of two as near); None if no current fragment can be cut at all.
    """
    goal = len(problem.log_goal)
    ways = _ways(known, possible)[-1]
    derived = [n for n in range(len(problem.log_current) + 1, len(ways)) if ways[n] > 0.0]
    return min(derived, key=lambda n: (abs(n - goal), n), default=None)


def draw_types(
    known: Derivations, possible: Floats, terminals: int, count: int, rng: np.random.Generator
) -> list[tuple[int, ...]]:
    """The different ones among `count` draws of the current fragments' types, in the order first drawn.

    Args:
        known: what the grammar derives.
        possible: (m, k) from `possible_types`.
        terminals: number that the types must be able to derive together.
        count: number of draws.
        rng: random stream.

    Raises:
        ValueError: no types can derive that number.
    """
    if not _ways(known, possible)[-1][terminals] > 0.0:
        raise ValueError(f"the current fragments cannot derive {terminals} terminals")
    ways, yields = _weighted_ways(known, possible), possible @ known.mass
    drawn: dict[tuple[int, ...], None] = {}
    for _ in range(count):
        left, types = terminals, [0] * len(possible)
        for i in range(len(possible) - 1, -1, -1):
            # Terminals 1 to `left` for fragment i, the others for those before it.
            share = 1 + _drawn(yields[i, 1 : left + 1] * ways[i][left - 1 :: -1], rng)
            types[i] = _drawn(possible[i] * known.mass[:, share], rng)
            left -= share
        drawn[tuple(types)] = None
    return list(drawn)


def _drawn(weights: Floats, rng: np.random.Generator) -> int:
    """An index drawn in proportion to weights (n,), of which one at least is positive."""
    below = np.cumsum(weights)
    return min(int(np.searchsorted(below, rng.random() * below[-1], side="right")), int(np.flatnonzero(weights)[-1]))


def _ways(known: Derivations, possible: Floats) -> list[Floats]:
    """Sum, over all ways to share n terminals out, of the probability that the first i fragments have types that can.

    One row (N + 1,) by n for every i from 0 to m.
    """
    size = known.mass.shape[1]
    ways = [np.eye(1, size)[0]]
    for row in possible:
        wider = np.convolve(ways[-1], row @ (known.mass > 0.0))[:size]
        ways.append(wider)
    return ways


def _weighted_ways(known: Derivations, possible: Floats) -> list[Floats]:
    """The same with the mass of the parse trees, up to a factor a row."""
    ways = [np.eye(1, known.mass.shape[1])[0]]
    for row in possible:
        wider = np.convolve(ways[-1], row @ known.mass)[: known.mass.shape[1]]
        scaled = wider / wider.max()
        ways.append(np.where(wider > 0.0, np.maximum(scaled, SMALLEST), 0.0))
    return ways
