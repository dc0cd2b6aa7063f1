"""Monte Carlo tree search for the best parse tree (III-B): select, expand, roll out, evaluate, back up.

A node of the search tree is a parse tree grown in canonical order (see `parse_tree`); below the root, which holds v_S,
stand the types drawn for the current fragments. Scores are log posteriors (Eq. 8, with the grounding of Eq. 9); for the
selection by UCT they are scaled to [0, 1] between the worst and the best seen so far. What is explored to its end is
not visited again. The best rollout of all rounds is the result.

Searches under different keys are independent, and `best_of` is a maximum with a fixed tie-break, so that the plan
depends on the set of keys alone and not on who searched which.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
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
class SearchResult:
    """The best parse tree of one search or of several.

    Attributes:
        tree: the parse tree.
        grounding: (t,) index of the goal's fragment for every terminal, `UNGROUNDED` for none.
        posterior: the terms of Eq. (3).
        missing: by how many terminals the tree differs from the goal; not 0 for a dead end.
        history: best log posterior after each round.
        rollouts: number of rollouts made.
        dead_ends: how many of them had another number of terminals than the goal.
    """

    tree: ParseTree
    grounding: Ints
    posterior: Posterior
    missing: int
    history: tuple[float, ...]
    rollouts: int
    dead_ends: int


@dataclass
class _Node:
    """A node of the search tree: the decisions that lead here from its parent, and what is known of it.

    Attributes:
        decisions: the choice taken, then all that were forced by it.
        untried: choices not yet tried, the next last.
        children: by the choice taken.
        visits, total: number and sum of the scores backed up.
        explored: every parse tree below was evaluated.
    """

    decisions: tuple[int, ...] = ()
    untried: list[int] = field(default_factory=list)
    children: list["_Node"] = field(default_factory=list)
    visits: int = 0
    total: float = 0.0
    explored: bool = False


def search(problem: Problem, key: int, settings: SearchSettings) -> SearchResult:
    """The best parse tree that one search finds.

    Args:
        problem: the goal, the current fragments and the grammar.
        key: seed of this search; the same key gives the same result.
        settings: rounds, exploration, annealing.

    Raises:
        ValueError: no current fragment can be cut (`start.target_terminals` tells beforehand).
    """
    return _Search(problem, np.random.default_rng(key), settings).run()


def best_of(found: Sequence[SearchResult]) -> SearchResult:
    """The best of several searches, whatever their order: by terminals missing, then posterior, then a tie-break.

    Raises:
        ValueError: nothing to choose from.
    """
    if not found:
        raise ValueError("there is no search to take the best of")
    best = min(found, key=_rank)
    longest = max(len(one.history) for one in found)
    histories = [one.history + (one.history[-1],) * (longest - len(one.history)) for one in found]
    return SearchResult(
        best.tree,
        best.grounding,
        best.posterior,
        best.missing,
        tuple(max(column) for column in zip(*histories, strict=True)),
        sum(one.rollouts for one in found),
        sum(one.dead_ends for one in found),
    )


def _rank(found: SearchResult) -> tuple[int, float, tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    tree = found.tree
    types, productions = tuple(tree.types.tolist()), tuple(tree.productions.tolist())
    return found.missing, -found.posterior.log, types, productions, tuple(found.grounding.tolist())


class _Search:
    """One search: its problem, its random streams and the best it has met."""

    def __init__(self, problem: Problem, rng: np.random.Generator, settings: SearchSettings) -> None:
        self.settings = settings
        self.order = _along_main_axis(problem.p_WG)
        self.problem = Problem(
            problem.grammar,
            problem.log_current,
            problem.log_goal[self.order],
            problem.p_WG[self.order],
            problem.layout_length_scale,
        )
        weights = terminal_weights(problem.log_goal)
        self.known: Derivations = derivations(problem.grammar, max_terminals(problem), weights)
        possible = possible_types(problem, settings.min_type_probability)
        terminals = target_terminals(problem, self.known, possible)
        if terminals is None:
            raise ValueError("no current fragment can be cut: no type it may have has productions")
        self.terminals = terminals
        self.starts = draw_types(self.known, possible, terminals, settings.starts, rng)
        self.rng = rng
        self.state = draws_from(rng)
        self.assigned: dict[bytes, Ints] = {}
        self.best: tuple[float, ParseTree, Ints] | None = None
        self.lowest, self.highest = math.inf, -math.inf

    def run(self) -> SearchResult:
        root = _Node(untried=list(range(len(self.starts) - 1, -1, -1)))
        history: list[float] = []
        for _ in range(self.settings.rounds):
            if root.explored:
                break
            path, growing = self._select_and_expand(root)
            tree = roll_out(self.known, growing, self.state)
            score = self._evaluate(tree)
            self._back_up(path, score)
            history.append(self.highest)
        return self._result(tuple(history))

    def _select_and_expand(self, root: _Node) -> tuple[list[_Node], PartialParseTree]:
        """Down by UCT to a node with untried choices, and one step on; the path and its parse tree."""
        node, path, growing = root, [root], None
        while not node.untried:
            node = self._favourite(node)
            path.append(node)
            growing = self._decide(growing, node.decisions)
        child = _Node(decisions=(node.untried.pop(),))
        growing = self._decide(growing, child.decisions)
        while growing.open:
            options, masses = choices(self.known, growing)
            if len(options) > 1:
                # Tried in a random order that follows the prior: the largest of Gumbel-perturbed log masses first.
                child.untried = options[np.argsort(np.log(masses) + self.rng.gumbel(size=len(options)))].tolist()
                break
            child.decisions += (int(options[0]),)
            growing = self._decide(growing, child.decisions[-1:])
        child.explored = not growing.open
        node.children.append(child)
        path.append(child)
        return path, growing

    def _decide(self, growing: PartialParseTree | None, decisions: tuple[int, ...]) -> PartialParseTree:
        """Carry on a parse tree; without one, the first decision is a choice of the current fragments' types."""
        if growing is None:
            growing, decisions = PartialParseTree.of(self.starts[decisions[0]], self.terminals), decisions[1:]
        for decision in decisions:
            children = () if decision == TERMINAL else self.known.productions[decision].children
            growing.decide(decision, children)
        return growing

    def _favourite(self, node: _Node) -> _Node:
        """The child that UCT selects among those not explored to their end."""
        spread = max(self.highest - self.lowest, 1e-12)
        log_visits = math.log(node.visits)

        def upper_bound(child: _Node) -> float:
            mean = (child.total / child.visits - self.lowest) / spread
            return mean + self.settings.exploration * math.sqrt(log_visits / child.visits)

        return max((child for child in node.children if not child.explored), key=upper_bound)

    def _evaluate(self, tree: ParseTree) -> float:
        """Ground a finished parse tree (Eq. 9) and score it (Eq. 8)."""
        problem = self.problem
        types = tree.types[tree.terminals]
        order = np.argsort(types, kind="stable")
        kind = types[order].tobytes()
        if kind not in self.assigned:  # the assignment depends on the types alone
            self.assigned[kind] = assign(types[order], problem.log_goal)
        grounding = np.empty_like(types)
        grounding[order] = self.assigned[kind]
        swaps = self.settings.swaps * len(types)
        grounding, layout = anneal(tree, grounding, problem.p_WG, problem.layout_length_scale, swaps, self.state)
        score = (
            log_prior(tree, self.known.log_probabilities, problem.log_current)
            + log_shape(tree, grounding, problem.log_goal)
            + layout
        )
        if self.best is None or score > self.best[0]:
            self.best = (score, tree, grounding)
        self.lowest, self.highest = min(self.lowest, score), max(self.highest, score)
        return score

    @staticmethod
    def _back_up(path: list[_Node], score: float) -> None:
        for node in reversed(path):
            node.visits += 1
            node.total += score
            if not node.untried and node.children:
                node.explored = all(child.explored for child in node.children)

    def _result(self, history: tuple[float, ...]) -> SearchResult:
        assert self.best is not None, "a search has at least one round"
        _, tree, grounding = self.best
        original = np.where(grounding == UNGROUNDED, UNGROUNDED, self.order[grounding])
        missing = abs(self.terminals - len(self.order))
        posterior = log_posterior(self.problem, self.known, tree, grounding)
        return SearchResult(tree, original, posterior, missing, history, len(history), len(history) if missing else 0)


def _along_main_axis(points: Floats) -> Ints:
    """Order of points (n, 3) along their main axis, so that a search does not depend on how the goal is numbered."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    axis = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])
    return np.argsort(np.round(centred @ axis, 12), kind="stable")
