"""The best parse tree and grounding by enumeration: an oracle for small problems (up to six goal fragments or so).

Written for its plainness and from Section III alone, it shares with the search nothing but the posterior.
"""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from cutgrammar.geometry.arrays import Ints
from cutgrammar.inference.grounding import assign
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree
from cutgrammar.inference.posterior import Posterior, log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import Derivations


def parse_trees(known: Derivations, types: tuple[int, ...], terminals: int) -> Iterator[ParseTree]:
    """Every parse tree of current fragments of these types that has this number of terminals, each once."""
    for sequence in _sequences(known, types, terminals):
        grown: list[tuple[int, int, int]] = []
        open_leaves = [(c, START) for c in reversed(types)]
        for production in sequence:
            c, parent = open_leaves.pop()
            if production != TERMINAL:
                children = known.productions[production].children
                open_leaves.extend((child, len(grown)) for child in reversed(children))
            grown.append((c, parent, production))
        yield ParseTree(*np.array(grown, dtype=np.int64).T)


def _sequences(known: Derivations, types: tuple[int, ...], terminals: int) -> Iterator[tuple[int, ...]]:
    """The decisions, in preorder, by which leaves of these types yield this number of terminals."""
    if not types or terminals < len(types):
        if not types and terminals == 0:
            yield ()
        return
    for rest in _sequences(known, types[1:], terminals - 1):
        yield (TERMINAL, *rest)
    for number, production in enumerate(known.productions):
        if production.parent == types[0]:
            for rest in _sequences(known, (*production.children, *types[1:]), terminals):
                yield (number, *rest)


def groundings(problem: Problem, tree: ParseTree) -> Iterator[Ints]:
    """Every grounding that the paper's two steps can reach: the best assignment, permuted within each type."""
    first = assign(tree.types[tree.terminals], problem.log_goal)
    types = tree.types[tree.terminals]
    groups = [np.flatnonzero(types == c) for c in np.unique(types)]
    for orders in product(*(permutations(first[group]) for group in groups)):
        grounding = first.copy()
        for group, order in zip(groups, orders, strict=True):
            grounding[group] = order
        yield grounding


def best_exactly(
    problem: Problem, known: Derivations, starts: list[tuple[int, ...]]
) -> tuple[Posterior, ParseTree, Ints] | None:
    """The best of all parse trees with as many terminals as the goal has fragments, and of all their groundings.

    Args:
        problem: the goal and the current fragments.
        known: of the problem's grammar.
        starts: the types that the current fragments may have.

    Returns:
        Its posterior, the tree and the grounding; None where there is no such tree.
    """
    best: tuple[Posterior, ParseTree, Ints] | None = None
    for types in starts:
        for tree in parse_trees(known, types, len(problem.log_goal)):
            for grounding in groundings(problem, tree):
                posterior = log_posterior(problem, known, tree, grounding)
                if best is None or posterior.log > best[0].log:
                    best = posterior, tree, grounding
                if posterior.log - posterior.log_layout <= best[0].log:
                    break  # no layout term is above 0, and the others are the same for all groundings
    return best
