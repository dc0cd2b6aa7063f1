"""Enumeration of all parse trees and groundings of a small goal, fast enough for hundreds of thousands of them.

It finds two optima. The first is the best result of the paper's two steps (III-B): each parse tree with the assignment
that maximises Eq. (5), whose fragments are then permuted among terminals of the same type. The second is the free
optimum of Eq. (9) over all groundings. Step (i) also tries all assignments. Parse trees are rows of tables, which are
combined from those of smaller trees. The code is independent of the search, and skips only candidates that a bound
excludes (the layout term is at most 0).
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

MAX_FRAGMENTS = 7
"""Maximum number of goal fragments; the number of groundings is its factorial."""
PADDING = -2
"""Pads rows of decisions to equal length."""

Rows = NDArray[np.int32]
Table = Mapping[tuple[int, int], Rows]
"""(type, number of terminals) -> (a, w) all parse trees: decisions in preorder, `TERMINAL` or a production."""


@dataclass(frozen=True, eq=False)
class Explained:
    """A grounded parse tree and its posterior."""

    tree: ParseTree
    grounding: Ints
    posterior: Posterior


@dataclass(frozen=True, eq=False)
class Enumerated:
    """The optima of a problem.

    Attributes:
        two_steps: the best that the paper's two steps of grounding allow.
        free: the best over all groundings.
        trees: number of parse trees with as many terminals as the goal has fragments.
    """

    two_steps: Explained
    free: Explained
    trees: int


def enumerate_all(problem: Problem) -> Enumerated | None:
    """The best of all parse trees and groundings; None if the grammar cannot derive the goal's number of fragments.

    Args:
        problem: the goal and the current fragments, which may have any type.

    Raises:
        ValueError: there are more goal fragments than `MAX_FRAGMENTS`.
    """
    goal, now = len(problem.log_goal), len(problem.log_current)
    if goal > MAX_FRAGMENTS:
        raise ValueError(f"{goal} goal fragments are too many to try all groundings; at most {MAX_FRAGMENTS}")
    derived = derivations(problem.grammar, goal)
    orders = np.array(list(permutations(range(goal))), dtype=np.int64)
    best = np.full(2, -np.inf)
    groundings = np.zeros((2, goal), dtype=np.int64)
    winners: list[ParseTree | None] = [None, None]
    count = 0
    table = parse_trees_by_size(derived.productions, problem.grammar.k, max(goal - now + 1, 1))
    for roots, rows in _forests(table, now, goal):
        count += len(rows)
        found = _compare(
            rows,
            roots,
            derived.log_probabilities,
            derived.first,
            derived.children,
            problem.log_current,
            problem.log_goal,
            problem.p_WG / problem.layout_length_scale,
            orders,
            best,
            groundings,
        )
        for which, row in enumerate(found):
            if row >= 0:
                winners[which] = tree_of(derived.productions, roots[row], rows[row])
    two_steps, free = winners
    if two_steps is None or free is None:
        return None
    results = [
        Explained(tree, grounding, log_posterior(problem, derived, tree, grounding))
        for tree, grounding in ((two_steps, groundings[0]), (free, groundings[1]))
    ]
    return Enumerated(results[0], results[1], count)


def parse_trees_by_size(productions: tuple[Production, ...], k: int, terminals: int) -> Table:
    """All parse trees of every type with at most this number of terminals, combined from smaller ones."""
    table: dict[tuple[int, int], Rows] = {(c, 1): np.full((1, 1), TERMINAL, dtype=np.int32) for c in range(k)}
    for n in range(2, terminals + 1):
        parts: dict[int, list[Rows]] = {c: [] for c in range(k)}
        for number, production in enumerate(productions):
            for sizes in _compositions(n, len(production.children)):
                below = _combinations([table[c, size] for c, size in zip(production.children, sizes, strict=True)])
                parts[production.parent].append(np.insert(below, 0, number, axis=1))
        for c in range(k):
            table[c, n] = _padded(parts[c], 2 * n - 1)
    return table


def tree_of(productions: tuple[Production, ...], roots: Ints, decisions: Rows) -> ParseTree:
    """The parse tree with root types `roots` (m,) that a row of decisions describes."""
    grown: list[tuple[int, int, int]] = []
    open_leaves = [(int(c), START) for c in reversed(roots)]
    for decision in decisions[decisions != PADDING].tolist():
        c, parent = open_leaves.pop()
        if decision != TERMINAL:
            open_leaves.extend((child, len(grown)) for child in reversed(productions[decision].children))
        grown.append((c, parent, decision))
    return ParseTree(*np.array(grown, dtype=np.int64).T)


def _forests(table: Table, now: int, goal: int) -> Iterator[tuple[Ints, Rows]]:
    """(a, m) root types and (a, w) decisions of all parse trees, in batches."""
    k = 1 + max(c for c, _ in table)
    whole: dict[int, tuple[Rows, Rows]] = {}  # by size: (a, 1) types and their parse trees
    for n in range(1, goal - now + 2 if now > 1 else 1):
        types = np.repeat(np.arange(k, dtype=np.int32), [len(table[c, n]) for c in range(k)])
        whole[n] = types[:, None], _padded([table[c, n] for c in range(k)], 2 * n - 1)
    for sizes in _compositions(goal, now):
        for c in range(k):  # in batches, to limit memory
            first = table[c, sizes[0]]
            if not len(first):
                continue
            own = np.full((len(first), 1), c, dtype=np.int32)
            roots = _combinations([own, *(whole[n][0] for n in sizes[1:])])
            rows = _combinations([first, *(whole[n][1] for n in sizes[1:])])
            yield roots.astype(np.int64), rows


def _compositions(total: int, parts: int) -> Iterator[tuple[int, ...]]:
    """All ways to write `total` as an ordered sum of `parts` positive whole numbers."""
    return (sizes for sizes in product(range(1, total - parts + 2), repeat=parts) if sum(sizes) == total)


def _combinations(blocks: list[Rows]) -> Rows:
    """All concatenations of one row from each block; the last block varies fastest."""
    counts = [len(block) for block in blocks]
    columns = [
        np.tile(np.repeat(block, prod(counts[i + 1 :]), axis=0), (prod(counts[:i]), 1))
        for i, block in enumerate(blocks)
    ]
    return np.concatenate(columns, axis=1).astype(np.int32)


def _padded(blocks: list[Rows], width: int) -> Rows:
    """Concatenate blocks of rows, padded to `width` columns."""
    filled = [np.pad(b, ((0, 0), (0, width - b.shape[1])), constant_values=PADDING) for b in blocks if len(b)]
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
    positions: Compiled,
    orders: Compiled,
    best: Compiled,
    groundings: Compiled,
) -> Compiled:
    """Update `best` and `groundings` with the rows' parse trees; return (2,) the rows of new optima, or -1."""
    goal, width = len(log_goal), rows.shape[1]
    found = np.full(2, -1)
    max_shape = 0.0
    for g in range(goal):
        max_shape += log_goal[g].max()
    parents, at, stack = np.empty(width, np.int64), np.empty(goal, np.int64), np.empty((2 * goal, 2), np.int64)
    types, given = np.empty(goal, np.int64), np.empty(goal, np.int64)
    sums, counts = np.empty((width, 3)), np.empty(width, np.int64)
    shapes = np.empty(len(orders))
    for row in range(len(rows)):
        prior = 0.0
        for i in range(roots.shape[1]):
            prior += log_current[i, roots[row, i]]
        for i in range(width):
            if rows[row, i] >= 0:
                prior += log_probabilities[rows[row, i]]
        if prior + max_shape <= best[0]:
            continue  # best[1] is never below best[0]

        height, nodes, leaves = 0, 0, 0
        for i in range(roots.shape[1] - 1, -1, -1):
            stack[height, 0], stack[height, 1] = roots[row, i], -1
            height += 1
        for i in range(width):
            decision = rows[row, i]
            if decision == PADDING:
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
            allowed = True  # by step (ii) each fragment keeps the type from step (i)
            for t in range(goal):
                if given[orders[o, t]] != types[t]:
                    allowed = False
            if bound <= best[1] and not (allowed and bound > best[0]):
                continue
            score = bound - _spread(parents, nodes, at, orders[o], positions, sums, counts)
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
    positions: Compiled,
    sums: Compiled,
    counts: Compiled,
) -> float:
    """Sum of the distances of nodes from their parents in units of the length scale: minus the log of Eq. (6)."""
    sums[:nodes] = 0.0
    counts[:nodes] = 0
    for t in range(len(at)):
        node = at[t]
        while node >= 0:
            for x in range(3):
                sums[node, x] += positions[grounding[t], x]
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
