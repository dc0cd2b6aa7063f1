"""All parse trees and all groundings of a small goal, by the hundred thousand: what a search is measured against.

Two optima are found at once. The first is the best that the paper's two steps allow (III-B): each parse tree with the
assignment that maximises Eq. (5), its fragments then permuted among terminals of the same type. The second is the free
optimum of Eq. (9): any fragment at any terminal, shape and layout weighed together. Step (i) is itself done by trying
every assignment. Parse trees are written out as rows of a table that grows from smaller ones. Nothing here is shared
with the search, and what is skipped is only what a bound rules out: no layout term is above 0.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations, product
from math import prod

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Ints
from cutgrammar.grammar.production import Production
from cutgrammar.inference.draws import Compiled
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree
from cutgrammar.inference.posterior import Posterior, log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations

MOST_FRAGMENTS = 7
"""A goal of more has too many groundings to try them all."""
NOTHING = -2
"""Fills a row up; it is skipped where it stands."""

Rows = NDArray[np.int32]
Table = Mapping[tuple[int, int], Rows]
"""(type, number of terminals) -> (a, w) all its parse trees: decisions in preorder, `TERMINAL` or a production."""


@dataclass(frozen=True, eq=False)
class Explained:
    """A grounded parse tree and how well it explains the goal."""

    tree: ParseTree
    grounding: Ints
    posterior: Posterior


@dataclass(frozen=True, eq=False)
class Enumerated:
    """What there is to be found.

    Attributes:
        two_steps: the best that the paper's two steps of grounding allow.
        free: the best over all groundings.
        trees: number of parse trees with as many terminals as the goal has fragments.
    """

    two_steps: Explained
    free: Explained
    trees: int


def enumerate_all(problem: Problem) -> Enumerated | None:
    """The best of all parse trees and groundings; None where the grammar cannot derive the goal's number of fragments.

    Args:
        problem: the goal and the current fragments, each of which may have any type.

    Raises:
        ValueError: more goal fragments than `MOST_FRAGMENTS`.
    """
    goal, now = len(problem.log_goal), len(problem.log_current)
    if goal > MOST_FRAGMENTS:
        raise ValueError(f"{goal} goal fragments are too many to try all groundings; at most {MOST_FRAGMENTS}")
    known = derivations(problem.grammar, goal)
    orders = np.array(list(permutations(range(goal))), dtype=np.int64)
    best = np.full(2, -np.inf)
    groundings = np.zeros((2, goal), dtype=np.int64)
    winners: list[ParseTree | None] = [None, None]
    count = 0
    table = parse_trees_by_size(known.productions, problem.grammar.k, max(goal - now + 1, 1))
    for roots, rows in _forests(table, now, goal):
        count += len(rows)
        found = _compare(
            rows,
            roots,
            known.log_probabilities,
            known.first,
            known.children,
            problem.log_current,
            problem.log_goal,
            problem.p_WG / problem.layout_length_scale,
            orders,
            best,
            groundings,
        )
        for which, row in enumerate(found):
            if row >= 0:
                winners[which] = tree_of(known.productions, roots[row], rows[row])
    two_steps, free = winners
    if two_steps is None or free is None:
        return None
    results = [
        Explained(tree, grounding, log_posterior(problem, known, tree, grounding))
        for tree, grounding in ((two_steps, groundings[0]), (free, groundings[1]))
    ]
    return Enumerated(results[0], results[1], count)


def parse_trees_by_size(productions: tuple[Production, ...], k: int, terminals: int) -> Table:
    """All parse trees of every type with up to this many terminals; those of n are made of those of fewer."""
    table: dict[tuple[int, int], Rows] = {(c, 1): np.full((1, 1), TERMINAL, dtype=np.int32) for c in range(k)}
    for n in range(2, terminals + 1):
        parts: dict[int, list[Rows]] = {c: [] for c in range(k)}
        for number, production in enumerate(productions):
            for sizes in _shares(n, len(production.children)):
                below = _side_by_side([table[c, size] for c, size in zip(production.children, sizes, strict=True)])
                parts[production.parent].append(np.insert(below, 0, number, axis=1))
        for c in range(k):
            table[c, n] = _stacked(parts[c], 2 * n - 1)
    return table


def tree_of(productions: tuple[Production, ...], roots: Ints, decisions: Rows) -> ParseTree:
    """The parse tree of current fragments of types `roots` (m,) that a row of decisions describes."""
    grown: list[tuple[int, int, int]] = []
    open_leaves = [(int(c), START) for c in reversed(roots)]
    for decision in decisions[decisions != NOTHING].tolist():
        c, parent = open_leaves.pop()
        if decision != TERMINAL:
            open_leaves.extend((child, len(grown)) for child in reversed(productions[decision].children))
        grown.append((c, parent, decision))
    return ParseTree(*np.array(grown, dtype=np.int64).T)


def _forests(table: Table, now: int, goal: int) -> Iterator[tuple[Ints, Rows]]:
    """(a, m) types of the current fragments and (a, w) decisions of all parse trees, in batches."""
    k = 1 + max(c for c, _ in table)
    whole: dict[int, tuple[Rows, Rows]] = {}  # by size, (a, 1) types and the parse trees of them all
    for n in range(1, goal - now + 2 if now > 1 else 1):
        types = np.repeat(np.arange(k, dtype=np.int32), [len(table[c, n]) for c in range(k)])
        whole[n] = types[:, None], _stacked([table[c, n] for c in range(k)], 2 * n - 1)
    for sizes in _shares(goal, now):
        for c in range(k):  # batch by batch, for the sake of memory
            first = table[c, sizes[0]]
            if not len(first):
                continue
            own = np.full((len(first), 1), c, dtype=np.int32)
            roots = _side_by_side([own, *(whole[n][0] for n in sizes[1:])])
            rows = _side_by_side([first, *(whole[n][1] for n in sizes[1:])])
            yield roots.astype(np.int64), rows


def _shares(total: int, parts: int) -> Iterator[tuple[int, ...]]:
    """All ways to write `total` as an ordered sum of `parts` positive whole numbers."""
    return (sizes for sizes in product(range(1, total - parts + 2), repeat=parts) if sum(sizes) == total)


def _side_by_side(blocks: list[Rows]) -> Rows:
    """Every combination of a row from each block, one after another in a row; the last block varies fastest."""
    counts = [len(block) for block in blocks]
    columns = [
        np.tile(np.repeat(block, prod(counts[i + 1 :]), axis=0), (prod(counts[:i]), 1))
        for i, block in enumerate(blocks)
    ]
    return np.concatenate(columns, axis=1).astype(np.int32)


def _stacked(blocks: list[Rows], width: int) -> Rows:
    """Blocks of rows one below another, filled up to `width` columns."""
    filled = [np.pad(b, ((0, 0), (0, width - b.shape[1])), constant_values=NOTHING) for b in blocks if len(b)]
    return np.concatenate(filled, dtype=np.int32) if filled else np.empty((0, width), dtype=np.int32)


@njit(cache=True)
def _compare(
    rows: Compiled,
    roots: Compiled,
    log_probabilities: Compiled,
    first: Compiled,
    children: Compiled,
    log_current: Compiled,
    log_goal: Compiled,
    places: Compiled,
    orders: Compiled,
    best: Compiled,
    groundings: Compiled,
) -> Compiled:
    """Raise `best` and `groundings` to those of the rows' parse trees; (2,) which rows did, -1 for none."""
    goal, most = len(log_goal), rows.shape[1]
    found = np.full(2, -1)
    ceiling = 0.0
    for g in range(goal):
        ceiling += log_goal[g].max()
    parents, at, stack = np.empty(most, np.int64), np.empty(goal, np.int64), np.empty((2 * goal, 2), np.int64)
    types, given = np.empty(goal, np.int64), np.empty(goal, np.int64)
    sums, counts = np.empty((most, 3)), np.empty(most, np.int64)
    shapes = np.empty(len(orders))
    for row in range(len(rows)):
        prior = 0.0
        for i in range(roots.shape[1]):
            prior += log_current[i, roots[row, i]]
        for i in range(most):
            if rows[row, i] >= 0:
                prior += log_probabilities[rows[row, i]]
        if prior + ceiling <= best[0]:
            continue  # best[1] is never below best[0]

        height, nodes, leaves = 0, 0, 0
        for i in range(roots.shape[1] - 1, -1, -1):
            stack[height, 0], stack[height, 1] = roots[row, i], -1
            height += 1
        for i in range(most):
            decision = rows[row, i]
            if decision == NOTHING:
                continue
            height -= 1
            c, parents[nodes] = stack[height, 0], stack[height, 1]
            if decision == TERMINAL:
                types[leaves], at[leaves] = c, nodes
                leaves += 1
            else:
                for j in range(first[decision + 1] - 1, first[decision] - 1, -1):
                    stack[height, 0], stack[height, 1] = children[j], nodes
                    height += 1
            nodes += 1

        step_one = 0
        for o in range(len(orders)):
            shapes[o] = 0.0
            for t in range(goal):
                shapes[o] += log_goal[orders[o, t], types[t]]
            if shapes[o] > shapes[step_one]:
                step_one = o
        if prior + shapes[step_one] <= best[0]:
            continue
        for t in range(goal):
            given[orders[step_one, t]] = types[t]
        for o in range(len(orders)):
            bound = prior + shapes[o]
            allowed = True  # by the paper's step (ii): each fragment keeps the type that step (i) gave it
            for t in range(goal):
                if given[orders[o, t]] != types[t]:
                    allowed = False
            if bound <= best[1] and not (allowed and bound > best[0]):
                continue
            score = bound - _spread(parents, nodes, at, orders[o], places, sums, counts)
            if score > best[1]:
                best[1], found[1] = score, row
                groundings[1] = orders[o]
            if allowed and score > best[0]:
                best[0], found[0] = score, row
                groundings[0] = orders[o]
    return found


@njit(cache=True)
def _spread(
    parents: Compiled,
    nodes: int,
    at: Compiled,
    grounding: Compiled,
    places: Compiled,
    sums: Compiled,
    counts: Compiled,
) -> float:
    """Distance of all nodes from their parents, in units of the layout length scale: minus the log of Eq. (6)."""
    sums[:nodes] = 0.0
    counts[:nodes] = 0
    for t in range(len(at)):
        node = at[t]
        while node >= 0:
            for x in range(3):
                sums[node, x] += places[grounding[t], x]
            counts[node] += 1
            node = parents[node]
    total = 0.0
    for node in range(nodes):
        if parents[node] >= 0:
            square = 0.0
            for x in range(3):
                square += (sums[node, x] / counts[node] - sums[parents[node], x] / counts[parents[node]]) ** 2
            total += np.sqrt(square)
    return total
