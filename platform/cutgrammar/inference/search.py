"""Monte Carlo tree search for the best parse tree (III-B): select, expand, roll out, evaluate, back up.

A node of the search tree is a partial parse tree in canonical order (see `parse_tree`). The root is v_S; its children
are the types sampled for the current fragments. Scores are log posteriors (Eq. 8, with the grounding of Eq. 9); for
selection by UCT they are scaled to [0, 1] between the worst and the best so far, or over a given range below the best.
Fully explored subtrees are not
visited again. The result is the best rollout of all rounds.

Searches with different keys are independent, and `best_of` is a maximum with a fixed tie-break, so the plan depends on
the set of keys alone and not on how they are distributed over workers.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.attributed_grounding import anneal_attributes
from cutgrammar.inference.attributes import log_stays
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.grounding import anneal, assign
from cutgrammar.inference.parse_tree import TERMINAL, ParseTree, PartialParseTree
from cutgrammar.inference.posterior import UNGROUNDED, Posterior, log_posterior, log_prior, log_shape
from cutgrammar.inference.problem import Problem, terminal_weights
from cutgrammar.inference.reachable import Derivations, derivations
from cutgrammar.inference.rollout import choices, roll_out
from cutgrammar.inference.start import draw_types, max_terminals, possible_types, target_terminals
from cutgrammar.settings import SearchSettings


@dataclass(frozen=True, eq=False)
class GroundedTree:
    """A parse tree with the best grounding found for it.

    Attributes:
        tree: the parse tree.
        grounding: (t,) index of the goal's fragment for every terminal, or `UNGROUNDED`.
        log_posterior: of the tree with this grounding.
    """

    tree: ParseTree
    grounding: Ints
    log_posterior: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best parse tree of one or several searches.

    Attributes:
        tree: the parse tree.
        grounding: (t,) index of the goal's fragment for every terminal, or `UNGROUNDED`.
        posterior: the terms of Eq. (3).
        missing: difference between the numbers of terminals and of goal fragments; nonzero for a dead end.
        history: best log posterior so far, after each round.
        rollouts: number of rollouts.
        dead_ends: number of rollouts whose number of terminals differs from the goal's.
        trees: the best distinct parse trees, best first, as many as the search was asked to keep.
    """

    tree: ParseTree
    grounding: Ints
    posterior: Posterior
    missing: int
    history: tuple[float, ...]
    rollouts: int
    dead_ends: int
    trees: tuple[GroundedTree, ...] = ()


@dataclass
class _Node:
    """A node of the search tree.

    Attributes:
        decisions: the choice made at the parent, then the decisions that it forces.
        untried: choices not tried yet; the next one is last.
        children: nodes of the choices already tried.
        visits, total: number and sum of the values backed up through this node: scores, or with
            `SearchSettings.score_range` their distance from the best so far on a scale from 1 to 0.
        explored: all parse trees below this node have been evaluated.
    """

    decisions: tuple[int, ...] = ()
    untried: list[int] = field(default_factory=list)
    children: list["_Node"] = field(default_factory=list)
    visits: int = 0
    total: float = 0.0
    explored: bool = False


def search(problem: Problem, key: int, settings: SearchSettings, n_trees: int = 0) -> SearchResult:
    """Run one search.

    Args:
        problem: the goal, the current fragments and the grammar.
        key: seed of this search; the same key gives the same result.
        settings: number of rounds, exploration constant, annealing.
        n_trees: number of distinct parse trees to keep in `SearchResult.trees`; it changes nothing else.

    Raises:
        ValueError: no current fragment can be cut (`start.target_terminals` is None).
    """
    return _Search(problem, np.random.default_rng(key), settings, n_trees).run()


def best_of(results: Sequence[SearchResult]) -> SearchResult:
    """The best of several results in any order: by terminals missing, then posterior, then a fixed tie-break.

    Raises:
        ValueError: `results` is empty.
    """
    if not results:
        raise ValueError("there are no search results to choose from")
    best = min(results, key=_rank)
    longest = max(len(result.history) for result in results)
    histories = [result.history + (result.history[-1],) * (longest - len(result.history)) for result in results]
    return SearchResult(
        best.tree,
        best.grounding,
        best.posterior,
        best.missing,
        tuple(max(column) for column in zip(*histories, strict=True)),
        sum(result.rollouts for result in results),
        sum(result.dead_ends for result in results),
        _best_trees(
            [found for result in results if result.missing == best.missing for found in result.trees],
            max(len(result.trees) for result in results),
        ),
    )


def _best_trees(found: Sequence[GroundedTree], n: int) -> tuple[GroundedTree, ...]:
    """The distinct parse trees of `found`, each with its best grounding, best first; at most n of them."""
    best: dict[bytes, GroundedTree] = {}
    for grounded in sorted(found, key=_tree_rank):
        best.setdefault(_identity(grounded.tree), grounded)
    return tuple(best.values())[:n]


def _identity(tree: ParseTree) -> bytes:
    """Equal for equal parse trees of one grammar: types and productions in preorder determine the parents."""
    return tree.types.tobytes() + tree.productions.tobytes()


def _tree_rank(found: GroundedTree) -> tuple[float, bytes, bytes]:
    return -found.log_posterior, _identity(found.tree), found.grounding.tobytes()


def _rank(result: SearchResult) -> tuple[int, float, tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    tree = result.tree
    types, productions = tuple(tree.types.tolist()), tuple(tree.productions.tolist())
    return result.missing, -result.posterior.log, types, productions, tuple(result.grounding.tolist())


class _Search:
    """State of one search: the problem, the random streams and the best parse tree so far."""

    def __init__(self, problem: Problem, rng: np.random.Generator, settings: SearchSettings, n_trees: int = 0) -> None:
        self.settings = settings
        self.order = _along_main_axis(problem.p_WG)
        attributes = problem.attributes and problem.attributes.ordered(self.order)
        self.problem = replace(
            problem, log_goal=problem.log_goal[self.order], p_WG=problem.p_WG[self.order], attributes=attributes
        )
        self.log_terminal = (
            self.problem.log_goal if attributes is None else self.problem.log_goal + attributes.log_terminal
        )
        weights = terminal_weights(problem.log_goal if attributes is None else self.log_terminal)
        whole = None if attributes is None or attributes.log_whole is None else np.exp(attributes.log_whole)
        self.derived: Derivations = derivations(problem.grammar, max_terminals(problem), weights, whole)
        possible = possible_types(problem, settings.min_type_probability)
        terminals = target_terminals(problem, self.derived, possible)
        if terminals is None:
            raise ValueError("no current fragment can be cut: none of its possible types has productions")
        self.n_terminals = terminals
        self.starts = draw_types(self.derived, possible, terminals, settings.n_starts, rng)
        self.rng = rng
        self.state = draws_from(rng)
        self.assignments: dict[bytes, Ints] = {}
        self.best: tuple[float, ParseTree, Ints] | None = None
        self.n_trees = n_trees
        self.trees: list[GroundedTree] = []
        self.lowest, self.highest = math.inf, -math.inf
        self.root = _Node(untried=list(range(len(self.starts) - 1, -1, -1)))

    def run(self) -> SearchResult:
        history: list[float] = []
        while len(history) < self.settings.max_rounds and not self.root.explored:
            self.play_round()
            history.append(self.highest)
        return self._result(tuple(history))

    def play_round(self) -> tuple[list[_Node], float]:
        """Select, expand, roll out, evaluate and back up once; return the path in the search tree and the score."""
        path, partial = self._select_and_expand(self.root)
        score = self._evaluate(roll_out(self.derived, partial, self.state))
        value = score
        if self.settings.score_range > 0.0:
            value = max(0.0, 1.0 + (score - self.highest) / self.settings.score_range)
        self._back_up(path, value)
        return path, score

    def _select_and_expand(self, root: _Node) -> tuple[list[_Node], PartialParseTree]:
        """Descend by UCT to a node with untried choices and expand one; return the path and its partial parse tree."""
        node, path, partial = root, [root], None
        while not node.untried:
            node = self._select_child(node)
            path.append(node)
            partial = self._decide(partial, node.decisions)
        child = _Node(decisions=(node.untried.pop(),))
        partial = self._decide(partial, child.decisions)
        while partial.open:
            options, masses = choices(self.derived, partial)
            if len(options) > 1:
                # A random order that follows the prior: the largest Gumbel-perturbed log mass is tried first.
                child.untried = options[np.argsort(np.log(masses) + self.rng.gumbel(size=len(options)))].tolist()
                break
            child.decisions += (int(options[0]),)
            partial = self._decide(partial, child.decisions[-1:])
        child.explored = not partial.open
        node.children.append(child)
        path.append(child)
        return path, partial

    def _decide(self, partial: PartialParseTree | None, decisions: tuple[int, ...]) -> PartialParseTree:
        """Apply decisions to a partial parse tree; if there is none yet, the first decision selects the root types."""
        if partial is None:
            partial, decisions = PartialParseTree.of(self.starts[decisions[0]], self.n_terminals), decisions[1:]
        for decision in decisions:
            children = () if decision == TERMINAL else self.derived.productions[decision].children
            partial.decide(decision, children)
        return partial

    def _select_child(self, node: _Node) -> _Node:
        """The child that UCT selects among those not fully explored."""
        spread = max(self.highest - self.lowest, 1e-12)
        log_visits = math.log(node.visits)
        is_scaled = self.settings.score_range > 0.0

        def upper_bound(child: _Node) -> float:
            mean = child.total / child.visits
            if not is_scaled:
                mean = (mean - self.lowest) / spread
            return mean + self.settings.exploration * math.sqrt(log_visits / child.visits)

        return max((child for child in node.children if not child.explored), key=upper_bound)

    def _evaluate(self, tree: ParseTree) -> float:
        """Ground a complete parse tree (Eq. 9) and score it (Eq. 8)."""
        problem = self.problem
        types = tree.types[tree.terminals]
        order = np.argsort(types, kind="stable")
        key = types[order].tobytes()
        if key not in self.assignments:  # the assignment depends only on the types
            self.assignments[key] = assign(types[order], self.log_terminal)
        grounding = np.empty_like(types)
        grounding[order] = self.assignments[key]
        swaps = self.settings.swaps_per_terminal * len(types)
        prior = log_prior(tree, self.derived.log_probabilities, problem.log_current)
        if problem.attributes is None:
            grounding, layout = anneal(tree, grounding, problem.p_WG, problem.layout_length_scale, swaps, self.state)
            score = prior + log_shape(tree, grounding, problem.log_goal) + layout
        else:
            grounding, rest = anneal_attributes(tree, grounding, problem, swaps, self.state)
            score = prior + log_stays(tree, problem.attributes) + rest
        if self.n_trees:
            self.trees.append(GroundedTree(tree, self._as_numbered(grounding), score))
        if self.best is None or score > self.best[0]:
            self.best = (score, tree, grounding)
        self.lowest, self.highest = min(self.lowest, score), max(self.highest, score)
        return score

    @staticmethod
    def _back_up(path: list[_Node], value: float) -> None:
        for node in reversed(path):
            node.visits += 1
            node.total += value
            if not node.untried and node.children:
                node.explored = all(child.explored for child in node.children)

    def _result(self, history: tuple[float, ...]) -> SearchResult:
        assert self.best is not None, "a search needs at least one round"
        _, tree, grounding = self.best
        missing = abs(self.n_terminals - len(self.order))
        posterior = log_posterior(self.problem, self.derived, tree, grounding)
        dead_ends = len(history) if missing else 0
        original, trees = self._as_numbered(grounding), _best_trees(self.trees, self.n_trees)
        return SearchResult(tree, original, posterior, missing, history, len(history), dead_ends, trees)

    def _as_numbered(self, grounding: Ints) -> Ints:
        """A grounding in the problem's own numbering of the goal."""
        return np.where(grounding == UNGROUNDED, UNGROUNDED, self.order[grounding])


def _along_main_axis(points: Floats) -> Ints:
    """Order of points (n, 3) along their main axis; it makes a search independent of the numbering of the goal."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    axis = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])
    return np.argsort(np.round(centred @ axis, 12), kind="stable")
