"""Finishing a parse tree at random: the simulation step of III-B, in compiled code.

Productions are drawn by their probabilities among the feasible ones: the open leaves are completed by a draw from the
grammar prior given the number of terminals still wanted (see `reachable`).
"""

import numpy as np
from numba import njit

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.draws import Compiled, State, uniform
from cutgrammar.inference.parse_tree import TERMINAL, ParseTree, PartialParseTree
from cutgrammar.inference.reachable import Derivations, bounded, convolved


def choices(known: Derivations, growing: PartialParseTree) -> tuple[Ints, Floats]:
    """What the leftmost open leaf can become, with the prior mass of each choice.

    Returns:
        (a,) `TERMINAL` or productions' numbers, only those from which the wanted number of terminals can be derived;
        (a,) their masses, which sum to 1.
    """
    types = np.array([c for c, _ in growing.open], dtype=np.int64)
    masses: Floats = _choices(types, growing.left, *known.arrays)
    feasible = np.flatnonzero(masses > 0.0)
    masses = masses[feasible]
    productions = np.where(feasible == 0, TERMINAL, feasible - 1 + known.options[types[-1]])
    return productions, np.asarray(masses / masses.sum())


def roll_out(known: Derivations, growing: PartialParseTree, state: State) -> ParseTree:
    """Complete a growing parse tree by a draw from the grammar prior given its number of terminals.

    Raises:
        ValueError: the open leaves cannot derive the number of terminals that is left.
    """
    decided = len(growing.types)
    size = decided + 2 * growing.left
    tree = np.empty((3, size), dtype=np.int64)
    tree[:, :decided] = growing.types, growing.parents, growing.productions
    if growing.open:
        leaves = np.array(growing.open, dtype=np.int64)
        size = _complete(tree, decided, leaves, growing.left, *known.arrays, state)
        if size < 0:
            raise ValueError(f"leaves of types {leaves[:, 0].tolist()} cannot derive {growing.left} terminals")
    return ParseTree(*tree[:, :size])


@njit(cache=True)
def _choices(
    types: Compiled,
    left: int,
    probabilities: Compiled,
    options: Compiled,
    first: Compiled,
    children: Compiled,  # noqa: ARG001
    mass: Compiled,
    tails: Compiled,
) -> Compiled:
    """Mass of the leaf types[-1] staying a terminal, then of each production of its type."""
    rest = np.zeros(left + 1)
    rest[0] = 1.0
    for i in range(len(types) - 1):
        wider = np.zeros(left + 1)
        for n in range(1, left + 1):
            wider[n] = convolved(mass[types[i]], rest, n)
        rest = wider
    c = types[-1]
    masses = np.zeros(1 + options[c + 1] - options[c])
    masses[0] = rest[left - 1]
    for r in range(options[c], options[c + 1]):
        masses[1 + r - options[c]] = bounded(probabilities[r] * convolved(tails[first[r]], rest, left))
    return masses


@njit(cache=True)
def _share(a: Compiled, b: Compiled, n: int, state: Compiled) -> int:
    """How many of n terminals fall to `a`, the rest to `b`: a draw by mass."""
    at = uniform(state) * convolved(a, b, n)
    last = -1
    for i in range(1, n + 1):
        mass = a[i] * b[n - i]
        if mass > 0.0:
            last = i
            at -= mass
            if at < 0.0:
                break
    return last


@njit(cache=True)
def _complete(
    tree: Compiled,
    decided: int,
    leaves: Compiled,
    left: int,
    probabilities: Compiled,
    options: Compiled,
    first: Compiled,
    children: Compiled,
    mass: Compiled,
    tails: Compiled,
    state: Compiled,
) -> int:
    """Complete `tree` (3, n) from its first `decided` columns; its number of nodes, or -1 if that cannot be done."""
    m = len(leaves)
    rests = np.zeros((m + 1, left + 1))  # rests[i]: of the leaves before i, which come after it in preorder
    rests[0, 0] = 1.0
    for i in range(m):
        for n in range(1, left + 1):
            rests[i + 1, n] = convolved(mass[leaves[i, 0]], rests[i], n)
    if rests[m, left] == 0.0:
        return -1

    # A stack of leaves with the number of terminals that each is to yield.
    stack = np.empty((2 * left + 1, 3), np.int64)
    node = decided
    for i in range(m - 1, -1, -1):
        share = _share(mass[leaves[i, 0]], rests[i], left, state)
        left -= share
        stack[0] = leaves[i, 0], leaves[i, 1], share
        height = 1
        while height > 0:
            height -= 1
            c, parent, n = stack[height]
            tree[0, node], tree[1, node], tree[2, node] = c, parent, -1
            if n > 1:
                at = uniform(state) * mass[c, n]
                chosen = -1
                for r in range(options[c], options[c + 1]):
                    weight = probabilities[r] * tails[first[r], n]
                    if weight > 0.0:
                        chosen = r
                        at -= weight
                        if at < 0.0:
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
                for s in range((height - lowest) // 2):  # the leftmost child goes on top
                    for q in range(3):
                        kept = stack[lowest + s, q]
                        stack[lowest + s, q] = stack[height - 1 - s, q]
                        stack[height - 1 - s, q] = kept
            node += 1
    return node
