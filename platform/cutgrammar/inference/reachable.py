"""Which numbers of terminals each fragment type can derive, and with what prior mass: one pass over counts.

A grammar has no probability for stopping (II-A), so how a rollout should decide between staying a terminal and
expanding is open. Reading taken: rollouts draw from the grammar prior (Eq. 4) given the number of terminals that the
goal asks for. The mass of type c at n terminals is the sum of Eq. (4) over all its parse trees with n terminals,

    mass[c, 1] = w[c],    mass[c, n] = sum over c -> b1 b2 ... of p(c -> b1 b2 ...) (mass[b1] * mass[b2] * ...)[n],

with * the convolution over counts and w = 1; or, so that rollouts know the goal, with w the weight of a type as a
terminal by how well the goal's fragments fit it (`problem.terminal_weights`). Where the mass is zero the type cannot
derive that number, so a rollout that draws by mass never takes a production that leads into a dead end while another
does not.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.draws import Compiled

SMALLEST, LARGEST = 1e-150, 1e150
"""Masses are kept between these, so that no product of two is lost; only how often a rollout draws them suffers."""


@dataclass(frozen=True, eq=False)
class Derivations:
    """A grammar as arrays, with what its types can derive up to a number of terminals N.

    Attributes:
        productions: all productions, sorted; a production's number is its place here.
        log_probabilities: (p,) log of their branching probabilities.
        probabilities: (p,).
        options: (k + 1,) the productions of type c are options[c] to options[c + 1] - 1.
        first: (p + 1,) the children of production r are children[first[r]] to children[first[r + 1] - 1].
        children: (b,) types of all productions' children, one production after another.
        mass: (k, N + 1) summed prior, with the terminals' weights, of every type's parse trees by number of terminals.
        tails: (b, N + 1) the same for each child together with its later siblings.
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
        """What the compiled functions take, in their order."""
        return self.probabilities, self.options, self.first, self.children, self.mass, self.tails


def derivations(grammar: Grammar, terminals: int, weights: Floats | None = None) -> Derivations:
    """What the types of `grammar` can derive with up to `terminals` terminals.

    Args:
        grammar: the grammar.
        terminals: the greatest number of terminals.
        weights: (k,) positive weight of each type as a terminal; None: 1 for all.

    Raises:
        ValueError: `terminals` or a weight is not positive.
    """
    if terminals < 1:
        raise ValueError(f"a parse tree has at least 1 terminal, not {terminals}")
    weights = np.ones(grammar.k) if weights is None else weights
    if weights.shape != (grammar.k,) or not weights.min() > 0.0:
        raise ValueError(f"{grammar.k} positive weights of terminals were expected, not {weights}")
    productions = tuple(sorted(p for p, share in grammar.probabilities.items() if share > 0.0))
    probabilities = np.array([grammar.probabilities[p] for p in productions], dtype=np.float64)
    parents = np.array([p.parent for p in productions], dtype=np.int64)
    first = np.concatenate([[0], np.cumsum([len(p.children) for p in productions])]).astype(np.int64)
    children = np.array([c for p in productions for c in p.children], dtype=np.int64)
    options = np.searchsorted(parents, np.arange(grammar.k + 1)).astype(np.int64)
    mass = np.zeros((grammar.k, terminals + 1))
    tails = np.zeros((len(children), terminals + 1))
    _fill(weights, probabilities, options, first, children, mass, tails)
    return Derivations(productions, np.log(probabilities), probabilities, options, first, children, mass, tails)


@njit(cache=True)
def bounded(mass: float) -> float:
    """A positive mass within `SMALLEST` and `LARGEST`; zero stays zero."""
    if mass == 0.0:
        return 0.0
    return min(max(mass, SMALLEST), LARGEST)


@njit(cache=True)
def convolved(a: Compiled, b: Compiled, n: int) -> float:
    """(a * b)[n]: the mass of n terminals shared by two (groups of) leaves; `a` yields at least one."""
    total = 0.0
    for i in range(1, n + 1):
        total += a[i] * b[n - i]
    kept: float = bounded(total)
    return kept


@njit(cache=True)
def _fill(
    weights: Compiled,
    probabilities: Compiled,
    options: Compiled,
    first: Compiled,
    children: Compiled,
    mass: Compiled,
    tails: Compiled,
) -> None:
    for n in range(1, mass.shape[1]):
        for r in range(len(probabilities)):
            for j in range(first[r + 1] - 2, first[r] - 1, -1):
                tails[j, n] = convolved(mass[children[j]], tails[j + 1], n)  # what stands at n itself is still zero
        for c in range(mass.shape[0]):
            total = weights[c] if n == 1 else 0.0
            for r in range(options[c], options[c + 1]):
                total += probabilities[r] * tails[first[r], n]
            mass[c, n] = bounded(total)
        for r in range(len(probabilities)):
            j = first[r + 1] - 1
            tails[j, n] = mass[children[j], n]
