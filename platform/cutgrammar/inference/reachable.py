"""The numbers of terminals that each fragment type can derive, with their prior mass, by dynamic programming.

A grammar has no stopping probability (II-A), so the paper leaves open how a rollout decides between a terminal and an
expansion. Reading taken: rollouts sample from the grammar prior (Eq. 4) conditioned on the number of terminals, which
the goal gives. The mass of type c at n terminals is the sum of Eq. (4) over all its parse trees with n terminals,

    mass[c, 1] = w[c],    mass[c, n] = sum over c -> b1 b2 ... of p(c -> b1 b2 ...) (mass[b1] * mass[b2] * ...)[n],

where * is the convolution over the number of terminals. The weight w of a type as a terminal is 1, or measures how well
the goal's fragments fit the type (`problem.terminal_weights`), so that rollouts are guided by the goal. If the mass is
zero, the type cannot derive that number; a rollout that samples by mass therefore avoids every dead end that can be
avoided.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.draws import Compiled

MIN_MASS, MAX_MASS = 1e-150, 1e150
"""Masses are clipped to this range so that products do not under- or overflow; this affects sampling rates only."""


@dataclass(frozen=True, eq=False)
class Derivations:
    """A grammar as arrays, with the masses of its types for up to N terminals.

    Attributes:
        productions: all productions, sorted; a production's number is its index in this tuple.
        log_probabilities: (p,) logs of their branching probabilities.
        probabilities: (p,) their branching probabilities, times that of being cut where `derivations` is given `whole`.
        options: (k + 1,) the productions of type c are options[c] to options[c + 1] - 1.
        first: (p + 1,) the children of production r are children[first[r]] to children[first[r + 1] - 1].
        children: (b,) types of the children of all productions, concatenated.
        mass: (k, N + 1) mass of every type by number of terminals (see the module).
        tails: (b, N + 1) joint mass of each child and its later siblings.
    """

    productions: tuple[Production, ...]
    log_probabilities: Floats
    probabilities: Floats
    options: Ints
    first: Ints
    children: Ints
    mass: Floats
    tails: Floats

    @property
    def arrays(self) -> tuple[Any, ...]:
        """All but the first two attributes, for compiled functions."""
        return self.probabilities, self.options, self.first, self.children, self.mass, self.tails


def derivations(
    grammar: Grammar, terminals: int, weights: Floats | None = None, whole: Floats | None = None
) -> Derivations:
    """The masses of all types of `grammar` for up to `terminals` terminals.

    Args:
        grammar: the grammar.
        terminals: maximum number of terminals N.
        weights: (k,) positive weight of each type as a terminal; None: 1 for all.
        whole: (k,) probability that a fragment of each type stays whole; None: the grammar has no such probability.
            The masses take it into account; `log_probabilities` are those of Eq. (2) all the same.

    Raises:
        ValueError: `terminals` or a weight is not positive.
    """
    if terminals < 1:
        raise ValueError(f"a parse tree has at least 1 terminal, not {terminals}")
    weights = np.ones(grammar.k) if weights is None else weights
    if weights.shape != (grammar.k,) or not weights.min() > 0.0:
        raise ValueError(f"expected {grammar.k} positive terminal weights, not {weights}")
    productions = tuple(sorted(p for p, share in grammar.probabilities.items() if share > 0.0))
    probabilities = np.array([grammar.probabilities[p] for p in productions], dtype=np.float64)
    parents = np.array([p.parent for p in productions], dtype=np.int64)
    first = np.concatenate([[0], np.cumsum([len(p.children) for p in productions])]).astype(np.int64)
    children = np.array([c for p in productions for c in p.children], dtype=np.int64)
    options = np.searchsorted(parents, np.arange(grammar.k + 1)).astype(np.int64)
    mass, tails = np.zeros((grammar.k, terminals + 1)), np.zeros((len(children), terminals + 1))
    log_probabilities = np.log(probabilities)
    if whole is not None:
        weights, probabilities = weights * whole, probabilities * (1.0 - whole[parents])
    derived = Derivations(productions, log_probabilities, probabilities, options, first, children, mass, tails)
    _fill(weights, derived.arrays)
    return derived


@njit(cache=True)
def bounded(mass: float) -> float:
    """A positive mass clipped to `MIN_MASS` to `MAX_MASS`; zero stays zero."""
    if mass == 0.0:
        return 0.0
    return min(max(mass, MIN_MASS), MAX_MASS)


@njit(cache=True)
def convolved(a: Compiled, b: Compiled, n: int) -> float:
    """(a * b)[n]: the mass of n terminals divided between two (groups of) leaves; `a` gets at least one."""
    total = 0.0
    for i in range(1, n + 1):
        total += a[i] * b[n - i]
    kept: float = bounded(total)
    return kept


@njit(cache=True)
def _fill(weights: Compiled, arrays: Compiled) -> None:
    """Compute `mass` and `tails` of `Derivations.arrays` in place."""
    probabilities, options, first, children, mass, tails = arrays
    for n in range(1, mass.shape[1]):
        for r in range(len(probabilities)):
            for j in range(first[r + 1] - 2, first[r] - 1, -1):
                tails[j, n] = convolved(mass[children[j]], tails[j + 1], n)  # its entry at n is still zero
        for c in range(mass.shape[0]):
            total = weights[c] if n == 1 else 0.0
            for r in range(options[c], options[c + 1]):
                total += probabilities[r] * tails[first[r], n]
            mass[c, n] = bounded(total)
        for r in range(len(probabilities)):
            j = first[r + 1] - 1
            tails[j, n] = mass[children[j], n]
