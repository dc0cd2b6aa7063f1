"""Random completion of a partial parse tree: the simulation step of III-B, in compiled code.

The open leaves are completed by sampling from the grammar prior conditioned on the number of remaining terminals (see
`reachable`), so only feasible productions are drawn.
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.draws import Compiled, State, uniform
from cutgrammar.inference.parse_tree import TERMINAL, ParseTree, PartialParseTree
from cutgrammar.inference.reachable import Derivations, bounded, convolved


def choices(derived: Derivations, partial: PartialParseTree) -> tuple[Ints, Floats]:
    """The feasible decisions for the leftmost open leaf, with their prior masses.

    Returns:
        (a,) `TERMINAL` or numbers of productions, those from which the remaining number of terminals can be derived;
        (a,) their masses, normalised to sum to 1.
    """
    types = np.array([c for c, _ in partial.open], dtype=np.int64)
    masses: Floats = _choices(types, partial.remaining, derived.arrays)
    feasible = np.flatnonzero(masses > 0.0)
    masses = masses[feasible]
    productions = np.where(feasible == 0, TERMINAL, feasible - 1 + derived.options[types[-1]])
    return productions, np.asarray(masses / masses.sum())


def roll_out(derived: Derivations, partial: PartialParseTree, state: State) -> ParseTree:
    """Complete a partial parse tree by sampling from the grammar prior given its number of terminals.

    Raises:
        ValueError: the open leaves cannot derive the number of remaining terminals.
    """
    decided = len(partial.types)
    size = decided + 2 * partial.remaining
    tree = np.empty((3, size), dtype=np.int64)
    tree[:, :decided] = partial.types, partial.parents, partial.productions
    if partial.open:
        leaves = np.array(partial.open, dtype=np.int64)
        size = _complete(tree, decided, leaves, partial.remaining, derived.arrays, state)
        if size < 0:
            raise ValueError(f"leaves of types {leaves[:, 0].tolist()} cannot derive {partial.remaining} terminals")
    return ParseTree(*tree[:, :size])


@njit(cache=True)
def _choices(types: Compiled, remaining: int, arrays: Compiled) -> Compiled:
    """Mass of the decision that leaf types[-1] is a terminal, followed by the mass of each production of its type."""
    probabilities, options, first, _, mass, tails = arrays
    rest = np.zeros(remaining + 1)
    rest[0] = 1.0
    for i in range(len(types) - 1):
        extended = np.zeros(remaining + 1)
        for n in range(1, remaining + 1):
            extended[n] = convolved(mass[types[i]], rest, n)
        rest = extended
    c = types[-1]
    masses = np.zeros(1 + options[c + 1] - options[c])
    masses[0] = rest[remaining - 1]
    for r in range(options[c], options[c + 1]):
        masses[1 + r - options[c]] = bounded(probabilities[r] * convolved(tails[first[r]], rest, remaining))
    return masses


@njit(cache=True)
def _share(a: Compiled, b: Compiled, n: int, state: Compiled) -> int:
    """Sample by mass how many of n terminals `a` gets; `b` gets the others."""
    threshold = uniform(state) * convolved(a, b, n)
    last = -1
    for i in range(1, n + 1):
        mass = a[i] * b[n - i]
        if mass > 0.0:
            last = i
            threshold -= mass
            if threshold < 0.0:
                break
    return last


@njit(cache=True)
def _complete(tree: Compiled, decided: int, leaves: Compiled, remaining: int, arrays: Compiled, state: Compiled) -> int:
    """Complete `tree` (3, n), whose first `decided` columns are given; return its number of nodes, -1 if infeasible."""
    probabilities, options, first, children, mass, tails = arrays
    m = len(leaves)
    rests = np.zeros((m + 1, remaining + 1))  # rests[i]: joint mass of leaves before i, which follow it in preorder
    rests[0, 0] = 1.0
    for i in range(m):
        for n in range(1, remaining + 1):
            rests[i + 1, n] = convolved(mass[leaves[i, 0]], rests[i], n)
    if rests[m, remaining] == 0.0:
        return -1

    # A stack of leaves: type, parent and number of terminals to derive.
    stack = np.empty((2 * remaining + 1, 3), np.int64)
    node = decided
    for i in range(m - 1, -1, -1):
        share = _share(mass[leaves[i, 0]], rests[i], remaining, state)
        remaining -= share
        stack[0] = leaves[i, 0], leaves[i, 1], share
        height = 1
        while height > 0:
            height -= 1
            c, parent, n = stack[height]
            tree[0, node], tree[1, node], tree[2, node] = c, parent, -1
            if n > 1:
                threshold = uniform(state) * mass[c, n]
                chosen = -1
                for r in range(options[c], options[c + 1]):
                    weight = probabilities[r] * tails[first[r], n]
                    if weight > 0.0:
                        chosen = r
                        threshold -= weight
                        if threshold < 0.0:
                            break
                tree[2, node] = chosen
                lowest = height
                for j in range(first[chosen], first[chosen + 1] - 1):
                    share = _share(mass[children[j]], tails[j + 1], n, state)
                    n -= share
                    stack[height] = children[j], node, share
                    height += 1
                stack[height] = children[first[chosen + 1] - 1], node, n
                height += 1
                for s in range((height - lowest) // 2):  # reverse, so that the leftmost child is on top
                    for q in range(3):
                        swapped = stack[lowest + s, q]
                        stack[lowest + s, q] = stack[height - 1 - s, q]
                        stack[height - 1 - s, q] = swapped
            node += 1
    return node
