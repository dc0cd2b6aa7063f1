"""The paper's method: infer the best parse tree of the goal, then carry out one of its productions (III, IV-B).

Every step plans anew from the current fragments. Of the productions that expand a current fragment one is drawn at
random, as in IV-B, and a cutting plane for it from the mixture density network (III-C). After a refusal the parse tree
of the step is kept, and production and plane are drawn again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Protocol

import numpy as np

from cutgrammar.cutting.planes import draws_left
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Configuration, same_configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.production import Production
from cutgrammar.inference.attributes import Attributes
from cutgrammar.inference.parse_tree import START, TERMINAL
from cutgrammar.inference.posterior import UNGROUNDED
from cutgrammar.inference.problem import Problem, shape_likelihood
from cutgrammar.inference.reachable import Derivations, derivations
from cutgrammar.inference.search import SearchResult, best_of, search
from cutgrammar.inference.start import max_terminals, possible_types, target_terminals
from cutgrammar.interfaces import Cut, Explanation, ParallelMap, Refusal, Stuck, TreeNode, run_serially
from cutgrammar.methods.method import Method
from cutgrammar.methods.shape_cache import ShapeCache
from cutgrammar.settings import Settings

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model


@dataclass(frozen=True, eq=False)
class Plan:
    """An inferred parse tree and what it was inferred from.

    Attributes:
        now, goal: the configurations that it leads from and to.
        z_now: (n, 17) shape features of the fragments of `now`.
        result: of the search.
        problem: what the search was given.
        derived: the derivations of the grammar, with the productions that the parse tree refers to by number.
    """

    now: Configuration
    goal: Configuration
    z_now: Floats
    result: SearchResult
    problem: Problem
    derived: Derivations

    def is_for(self, now: Configuration, goal: Configuration) -> bool:
        """Whether these are the configurations of the plan: the same shapes at the same places."""
        return same_configuration(self.now, now) and same_configuration(self.goal, goal)


@dataclass(frozen=True, eq=False)
class Chosen:
    """What of a plan is carried out next.

    Attributes:
        fragment: index of the current fragment to cut.
        production: the production that divides it.
        plane_C: the cutting plane in the fragment's canonical frame C.
        result: with the parse tree that the production belongs to, where that is not the plan's best.
    """

    fragment: int
    production: Production
    plane_C: Plane
    result: SearchResult | None = None


class Extension(Protocol):
    """What another method adds to the paper's: attributes in the posterior, and its own choice of the next cut."""

    @property
    def search(self) -> Callable[..., SearchResult]:
        """Takes the place of `search`: a function of the problem, a key and the settings of the search."""
        ...

    def attributes(self, now: Configuration, goal: Configuration) -> Attributes:
        """What is added to the problem of inferring `goal` from `now`."""
        ...

    def improved(self, plan: Plan, rng: np.random.Generator) -> Plan:
        """The plan of a step after the searches, perhaps with a better parse tree."""
        ...

    def choose(self, plan: Plan, draws: int, refused: Sequence[Refusal], rng: np.random.Generator) -> Chosen:
        """What of the plan is carried out, given the number of planes to draw and the cuts refused in this step."""
        ...


class GrammarPlanner:
    """Plans by inference of the best parse tree; keeps the shape features it has computed and the plan of the step.

    Args:
        model: the trained model.
        settings: of the search and of the choice of a plane.
        parallel_map: carries out the searches.
        extension: what another method adds; None for the paper's.
    """

    def __init__(
        self,
        model: "Model",
        settings: Settings,
        parallel_map: ParallelMap = run_serially,
        extension: Extension | None = None,
    ) -> None:
        self._extension = extension
        self._model = model
        self._settings = settings.search
        self._draws = settings.cutting.n_draws
        self._parallel_map = parallel_map
        self._features = ShapeCache(model.features)
        self._plan: Plan | None = None

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The next cut on the way from `now` to `goal` (see `Planner`)."""
        if len(now) >= len(goal):
            return Stuck(f"there are {len(now)} fragments already and the goal has {len(goal)}")
        if not (refused and self._plan and self._plan.is_for(now, goal)):
            z_now, z_goal = self._features(now, goal)
            problem = self._problem(now, goal, z_now, z_goal)
            known = derivations(problem.grammar, max_terminals(problem))
            possible = possible_types(problem, self._settings.min_type_probability)
            if target_terminals(problem, known, possible) is None:
                return Stuck(self._no_production(possible))
            keys = [int(key) for key in rng.integers(0, 2**63, size=self._settings.n_searches)]
            run = self._extension.search if self._extension else search
            result = best_of(self._parallel_map(partial(run, problem, settings=self._settings), keys))
            self._plan = Plan(now, goal, z_now, result, problem, known)
            if self._extension:
                self._plan = self._extension.improved(self._plan, rng)
        draws = draws_left(self._draws, len(refused))
        if self._extension:
            chosen = self._extension.choose(self._plan, draws, refused, rng)
        else:
            chosen = self._draw(self._plan, draws, rng)
        fragment = now[chosen.fragment]
        explanation = _explanation(chosen.result or self._plan.result, chosen.production)
        return Cut.of_fragment(fragment, chosen.plane_C, canonical_frame(fragment.shape), explanation)

    def _draw(self, plan: Plan, draws: int, rng: np.random.Generator) -> Chosen:
        """One production, drawn from those of the parse tree that expand a current fragment, and a plane for it."""
        expanding = plan.result.tree.productions[plan.result.tree.roots]
        chosen = int(rng.choice(np.flatnonzero(expanding != TERMINAL)))
        production = plan.derived.productions[expanding[chosen]]
        return Chosen(chosen, production, self._model.planes.sample(production, plan.z_now[chosen], rng, draws))

    def _problem(self, now: Configuration, goal: Configuration, z_now: Floats, z_goal: Floats) -> Problem:
        """What the searches are given, from the configurations and their shape features (n, 17)."""
        classifier, grammar = self._model.classifier, self._model.grammar
        return Problem(
            grammar=grammar,
            log_current=classifier.log_probabilities(z_now),
            log_goal=shape_likelihood(
                classifier.log_probabilities(z_goal), grammar, self._settings.divide_by_type_prior
            ),
            p_WG=np.array([fragment.p_WC for fragment in goal]),
            layout_length_scale=self._settings.layout_length_scale
            * sum(fragment.shape.volume for fragment in now) ** (1.0 / 3.0),
            attributes=self._extension.attributes(now, goal) if self._extension else None,
        )

    def _no_production(self, possible: Floats) -> str:
        types = ", ".join(f"c{c}" for c in np.flatnonzero(possible.any(axis=0)))
        floor = self._settings.min_type_probability
        return (
            f"no production applies: the current fragments can only be of types {types or '(none)'}, which no training "
            f"cut divided; lower search.min_type_probability ({floor:g}) or train on more cuts"
        )


def _explanation(result: SearchResult, production: Production) -> Explanation:
    tree = result.tree
    goals = dict(zip(tree.terminals.tolist(), result.grounding.tolist(), strict=True))
    fragments = {node: i for i, node in enumerate(tree.roots.tolist())}
    nodes = [TreeNode(parent=None, type=None)]
    for node, (c, parent) in enumerate(zip(tree.types.tolist(), tree.parents.tolist(), strict=True)):
        grounded = goals.get(node, UNGROUNDED)
        nodes.append(
            TreeNode(
                parent=0 if parent == START else parent + 1,
                type=c,
                now=fragments.get(node),
                goal=None if grounded == UNGROUNDED else grounded,
            )
        )
    return Explanation(
        tree=tuple(nodes),
        production=str(production),
        log_prior=result.posterior.log_prior,
        log_shape=result.posterior.log_shape,
        log_layout=result.posterior.log_layout,
        log_volume=result.posterior.log_volume,
        history=result.history,
        rollouts=result.rollouts,
        dead_ends=result.dead_ends,
        dead_end=result.missing != 0,
    )


GRAMMAR = Method(
    "grammar",
    lambda context: GrammarPlanner(context.model, context.settings, context.parallel_map),
    description="the paper's: MCTS over parse trees of the induced grammar, planes from a mixture density network",
    position=0,
)
