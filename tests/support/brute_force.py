"""The best parse tree and grounding by enumeration: an oracle for small problems (up to about six goal fragments).

It is written from Section III as plainly as possible and shares only the posterior and the assignment with the search.
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


def parse_trees(derived: Derivations, types: tuple[int, ...], terminals: int) -> Iterator[ParseTree]:
    """Every parse tree with current fragments of these types and this number of terminals, each once."""
    for sequence in _sequences(derived, types, terminals):
        grown: list[tuple[int, int, int]] = []
        open_leaves = [(c, START) for c in reversed(types)]
        for production in sequence:
            c, parent = open_leaves.pop()
            if production != TERMINAL:
                children = derived.productions[production].children
                open_leaves.extend((child, len(grown)) for child in reversed(children))
            grown.append((c, parent, production))
        yield ParseTree(*np.array(grown, dtype=np.int64).T)


def _sequences(derived: Derivations, types: tuple[int, ...], terminals: int) -> Iterator[tuple[int, ...]]:
    """The sequences of decisions, in preorder, by which leaves of these types derive this number of terminals."""
    if not types or terminals < len(types):
        if not types and terminals == 0:
            yield ()
        return
    for rest in _sequences(derived, types[1:], terminals - 1):
        yield (TERMINAL, *rest)
    for number, production in enumerate(derived.productions):
        if production.parent == types[0]:
            for rest in _sequences(derived, (*production.children, *types[1:]), terminals):
                yield (number, *rest)


def groundings(problem: Problem, tree: ParseTree) -> Iterator[Ints]:
    """Every grounding that the paper's two steps allow: the best assignment, permuted within each type."""
    first = assign(tree.types[tree.terminals], problem.log_goal)
    types = tree.types[tree.terminals]
    groups = [np.flatnonzero(types == c) for c in np.unique(types)]
    for orders in product(*(permutations(first[group]) for group in groups)):
        grounding = first.copy()
        for group, order in zip(groups, orders, strict=True):
            grounding[group] = order
        yield grounding


def best_by_enumeration(
    problem: Problem, derived: Derivations, starts: list[tuple[int, ...]]
) -> tuple[Posterior, ParseTree, Ints] | None:
    """The best of all parse trees with as many terminals as the goal has fragments, over all their groundings.

    Args:
        problem: the goal and the current fragments.
        derived: derivations of the problem's grammar.
        starts: the types that the current fragments can have.

    Returns:
        Its posterior, the tree and the grounding; None if there is no such tree.
    """
    best: tuple[Posterior, ParseTree, Ints] | None = None
    for types in starts:
        for tree in parse_trees(derived, types, len(problem.log_goal)):
            for grounding in groundings(problem, tree):
                posterior = log_posterior(problem, derived, tree, grounding)
                if best is None or posterior.log > best[0].log:
                    best = posterior, tree, grounding
                if posterior.log - posterior.log_layout <= best[0].log:
                    break  # the layout term is at most 0, and the others are the same for all groundings
    return best
