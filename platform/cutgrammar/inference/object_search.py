"""A search for each current fragment, once the goal's fragments are assigned to them (`object_assignment`).

Given the assignment, Eq. (3) with its additions is a product over the current fragments, so the best parse tree below
each is found by itself, in a space that is smaller by orders of magnitude than that of all of them together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutgrammar.geometry.arrays import Ints
from cutgrammar.inference.attributed_grounding import anneal_attributes
from cutgrammar.inference.draws import State, draws_from
from cutgrammar.inference.object_assignment import assign_objects
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree
from cutgrammar.inference.posterior import UNGROUNDED, log_posterior
from cutgrammar.inference.problem import Problem, terminal_weights
from cutgrammar.inference.reachable import Derivations, derivations
from cutgrammar.inference.search import GroundedTree, SearchResult, best_of, search
from cutgrammar.inference.start import max_terminals, possible_types, target_terminals
from cutgrammar.inference.subtrees import side_by_side
from cutgrammar.settings import SearchSettings

JOINT = 5
"""Factor of the number of swaps with which the joined tree is annealed."""


def search_by_object(problem: Problem, key: int, settings: SearchSettings, n_trees: int = 0) -> SearchResult:
    """Search the parse tree of each current fragment after assigning the goal's to them, and all trees together.

    Each of the two ways has half of the rounds, and the better result counts.

    Args, result and errors are those of `search`; if there are fewer goal fragments than current ones, or only one
    current fragment, it is that search. The problem must have attributes.
    """
    attributes = problem.attributes
    if attributes is None:
        raise ValueError("fragments are assigned by their volumes, but the problem has no attributes")
    m, g = len(problem.log_current), len(problem.log_goal)
    if m == 1 or g <= m:
        return search(problem, key, settings, n_trees)
    rng = np.random.default_rng(key)
    half = replace(settings, max_rounds=max(settings.max_rounds // 2, 1))
    together = search(problem, int(rng.integers(0, 2**63)), half, n_trees)
    weights = terminal_weights(problem.log_goal + attributes.log_terminal)
    whole = None if attributes.log_whole is None else np.exp(attributes.log_whole)
    derived = derivations(problem.grammar, max_terminals(problem), weights, whole)
    possible = possible_types(problem, settings.min_type_probability)
    assigned = assign_objects(problem, derived, possible, draws_from(rng))
    keys = rng.integers(0, 2**63, size=m)
    parts = [_search_one(problem, i, np.flatnonzero(assigned == i), int(keys[i]), half, n_trees) for i in range(m)]
    if all(part.best.tree.productions[0] == TERMINAL for part in parts):
        return together
    joined = _joined(problem, derived, parts, max(n_trees, 1))
    return best_of([together, _annealed(problem, derived, joined, settings, draws_from(rng))])


def _annealed(
    problem: Problem, derived: Derivations, result: SearchResult, settings: SearchSettings, state: State
) -> SearchResult:
    """The result with its best tree grounded anew, by swaps across the current fragments too, if that is better."""
    n_swaps = settings.swaps_per_terminal * len(result.grounding) * JOINT
    grounding, _ = anneal_attributes(result.tree, result.grounding, problem, n_swaps, state)
    posterior = log_posterior(problem, derived, result.tree, grounding)
    if posterior.log <= result.posterior.log:
        return result
    best = GroundedTree(result.tree, grounding, posterior.log)
    history = (*result.history[:-1], posterior.log)
    return replace(result, grounding=grounding, posterior=posterior, history=history, trees=(best, *result.trees[1:]))


@dataclass(frozen=True, eq=False)
class _Part:
    """What was found for one current fragment.

    Attributes:
        trees: the distinct parse trees below it, best first, grounded in the numbering of the whole problem.
        missing, history, rollouts, dead_ends: as in `SearchResult`.
    """

    trees: tuple[GroundedTree, ...]
    missing: int = 0
    history: tuple[float, ...] = ()
    rollouts: int = 0
    dead_ends: int = 0

    @property
    def best(self) -> GroundedTree:
        return self.trees[0]


def _search_one(problem: Problem, i: int, goals: Ints, key: int, settings: SearchSettings, n_trees: int) -> _Part:
    """Search the parse tree of current fragment i, which is to become the goal's fragments `goals` (n,)."""
    assert problem.attributes is not None
    part = replace(
        problem,
        log_current=problem.log_current[[i]],
        log_goal=problem.log_goal[goals],
        p_WG=problem.p_WG[goals],
        attributes=problem.attributes.part(i, goals),
    )
    possible = possible_types(part, settings.min_type_probability)
    known = derivations(part.grammar, max_terminals(part))
    if len(goals) == 1 or target_terminals(part, known, possible) is None:
        return _Part((_whole(part, known, goals),), missing=len(goals) - 1)
    found = search(part, key, settings, max(n_trees, 1))
    trees = tuple(GroundedTree(t.tree, _renumbered(t.grounding, goals), t.log_posterior) for t in found.trees)
    return _Part(trees, found.missing, found.history, found.rollouts, found.dead_ends)


def _whole(part: Problem, known: Derivations, goals: Ints) -> GroundedTree:
    """The best tree of one terminal, grounded in the goal fragment that fits best."""
    assert part.attributes is not None
    fits = part.log_current + part.log_goal + part.attributes.log_terminal
    if part.attributes.log_whole is not None:
        fits = fits + part.attributes.log_whole
    g, c = np.unravel_index(int(np.argmax(fits)), fits.shape)
    tree = ParseTree(np.array([c]), np.array([START]), np.array([TERMINAL]))
    posterior = log_posterior(part, known, tree, np.array([g]))
    return GroundedTree(tree, goals[[g]], posterior.log)


def _renumbered(grounding: Ints, goals: Ints) -> Ints:
    return np.where(grounding == UNGROUNDED, UNGROUNDED, goals[grounding])


def _joined(problem: Problem, derived: Derivations, parts: Sequence[_Part], n_trees: int) -> SearchResult:
    """The parts side by side below v_S; the kept trees differ from the best in one part each."""
    bests = [part.best for part in parts]
    total = sum(best.log_posterior for best in bests)
    others = [
        (total - bests[i].log_posterior + tree.log_posterior, i, j)
        for i, part in enumerate(parts)
        for j, tree in enumerate(part.trees[1:], start=1)
    ]
    chosen = sorted(others, key=lambda other: (-other[0], other[1:]))[: n_trees - 1]
    trees = [side_by_side(bests)]
    trees += [side_by_side([*bests[:i], parts[i].trees[j], *bests[i + 1 :]]) for _, i, j in chosen]
    posterior = log_posterior(problem, derived, trees[0].tree, trees[0].grounding)
    rounds = max(len(part.history) for part in parts)
    history = np.zeros(rounds)
    for part in parts:
        history += np.array(part.history + (part.best.log_posterior,) * (rounds - len(part.history)))
    rollouts = sum(part.rollouts for part in parts)
    missing = sum(part.missing for part in parts)
    return SearchResult(
        trees[0].tree,
        trees[0].grounding,
        posterior,
        missing,
        tuple(history.tolist()),
        rollouts,
        rollouts if missing else 0,
        tuple(trees),
    )
