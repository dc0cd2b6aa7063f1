"""`grammar-plus`: the paper's method with a posterior that plans (see `inference.attributes`, `cutting.plane_choice`).

Each addition is a setting of the table `plus`. The goal's shapes are used in the search only by their features and
volumes; the choice of a plane compares products with the shapes themselves.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.cutting.plane_choice import PlaneWeights, Wanted, choose_plane
from cutgrammar.cutting.planes import draw_planes
from cutgrammar.cutting.virtual_slicing import Body, body_of, union_of
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh, vertices_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.type_statistics import TypeStatistics
from cutgrammar.inference.attributes import Attributes
from cutgrammar.inference.object_search import search_by_object
from cutgrammar.inference.parse_tree import TERMINAL
from cutgrammar.inference.posterior import UNGROUNDED, log_posterior
from cutgrammar.inference.search import GroundedTree, SearchResult, search
from cutgrammar.inference.subtrees import subtree
from cutgrammar.interfaces import Refusal
from cutgrammar.methods.grammar import Chosen, GrammarPlanner, Plan
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.methods.plan_memory import LeftOver, with_left_over
from cutgrammar.perception.feature import scale_of
from cutgrammar.settings import Settings

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model


def statistics_of(model: "Model") -> TypeStatistics:
    """The statistics of the fragment types, as the model holds them.

    Raises:
        InputError: the model was trained by a version that did not keep them.
    """
    data = model.induction.get("type_statistics")
    if data is None or len(data["log_volume"]) != model.grammar.k:
        raise InputError(
            "the model does not hold the statistics of its fragment types, which grammar-plus needs; train again"
        )
    return TypeStatistics.from_json(data)


def has_layout(goal: Configuration) -> bool:
    """Whether the places of the goal's fragments tell which belong together.

    They do where at least half of the fragments have a neighbour whose bounding sphere, about the centroid, touches
    theirs. Fragments that are cut and left where they are do; fragments that were laid out apart do not.
    """
    if len(goal) < 2:
        return False
    places = np.array([fragment.p_WC for fragment in goal])
    radii = np.array([np.linalg.norm(vertices_of(f.shape) - f.shape.centroid, axis=1).max() for f in goal])
    distances = np.linalg.norm(places[:, None] - places, axis=2)
    near = distances < np.add.outer(radii, radii)
    np.fill_diagonal(near, False)
    return bool(near.any(axis=1).mean() >= 0.5)


class Additions:
    """The additions, as an `Extension` of the paper's planner; keeps the bodies it has made."""

    def __init__(self, model: "Model", settings: Settings) -> None:
        self._model = model
        self._settings = settings.plus
        self._statistics = statistics_of(model)
        self._swaps = settings.search.swaps_per_terminal
        self._left: LeftOver | None = None
        self._bodies: dict[int, tuple[Mesh | Cloud, Body]] = {}
        run = search_by_object if settings.plus.assign_objects else search
        self.search: Callable[..., SearchResult] = partial(run, n_trees=settings.plus.n_trees)

    def attributes(self, now: Configuration, goal: Configuration) -> Attributes:
        """Volumes of the fragments and of the types; the goal's volumes are scaled to those of what is cut."""
        current = np.array([fragment.shape.volume for fragment in now])
        wanted = np.array([fragment.shape.volume for fragment in goal])
        plus, types = self._settings, self._statistics
        return Attributes(
            goal_volumes=wanted * (current.sum() / wanted.sum()),
            current_volumes=current,
            log_volume=types.log_volume,
            log_volume_std=types.log_volume_std,
            volume_weight=plus.volume_weight,
            conservation=plus.conservation,
            log_whole=np.log(types.whole) if plus.whole else None,
            layout=plus.scattered_layout or has_layout(goal),
            swap_types=plus.swap_types,
        )

    def improved(self, plan: Plan, rng: np.random.Generator) -> Plan:
        """The plan with what is left of the last one, where that is better."""
        left, self._left = self._left, None
        return with_left_over(plan, left, self._swaps, rng)

    def choose(self, plan: Plan, draws: int, refused: Sequence[Refusal], rng: np.random.Generator) -> Chosen:
        """A fragment that the best parse tree cuts, and the plane whose virtual products fit best.

        The fragment is drawn as in IV-B, or all are tried and the one with the best fit is taken.
        """
        best = plan.result.tree
        cut = np.flatnonzero(best.productions[best.roots] != TERMINAL)
        tried = cut if self._settings.best_first else [rng.choice(cut)]
        proposals = [self._proposal(plan, int(fragment), draws, refused, rng) for fragment in tried]
        _, chosen, self._left = max(proposals, key=lambda proposal: proposal[0])
        return chosen

    def _proposal(
        self, plan: Plan, fragment: int, draws: int, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> tuple[float, Chosen, LeftOver | None]:
        """How a current fragment would be cut: how well the products fit, the cut, and what it leaves of the plan."""
        found = voted(plan.result, fragment, self._settings.marginal)
        root = int(found.tree.roots[fragment])
        production, z = plan.derived.productions[found.tree.productions[root]], plan.z_now[fragment]
        posterior = log_posterior(plan.problem, plan.derived, found.tree, found.grounding)
        result = replace(plan.result, tree=found.tree, grounding=found.grounding, posterior=posterior)
        children = found.tree.children(root)
        wanted = self.wanted(plan.goal, found, children)
        if not self._settings.virtual_slicing or wanted is None:
            plane = self._model.planes.sample(production, z, rng, draws)
            return 0.0, Chosen(fragment, production, plane, result), None
        drawn = draw_planes(self._model.planes.mixture(production, z), rng, draws)
        plus = self._settings
        weights = PlaneWeights(plus.fit_weight, plus.spread_weight, plus.adjust_offset, plus.adjust_tilt)
        scale, body = scale_of(z), self._body(plan.now[fragment].shape)
        avoided = _refused_planes(plan.now, fragment, refused) / np.array([1.0, 1.0, 1.0, scale])
        chosen = choose_plane(body, wanted, drawn, scale, weights, avoided)
        left = None
        if self._settings.keep_plan and len(children) == 2:
            above, below = chosen.above[0], 1 - chosen.above[0]
            shares = {above: chosen.share, below: 1.0 - chosen.share}
            volumes = [max(shares[i], 1e-9) * body.volume for i in (0, 1)]
            left = LeftOver.after(plan, found, fragment, children.tolist(), volumes)
        plane = Plane(chosen.numbers[:3], float(chosen.numbers[3]))
        return chosen.score, Chosen(fragment, production, plane, result), left

    def wanted(self, goal: Configuration, found: GroundedTree, children: Ints) -> list[Wanted] | None:
        """What the children of a root are to become; None where nothing is grounded below one of them."""
        together = self._settings.union_shapes and has_layout(goal)
        wanted = []
        for child in children.tolist():
            grounded = subtree(found, child).grounding
            fragments = [goal[g] for g in grounded.tolist() if g != UNGROUNDED]
            if not fragments:
                return None
            volume = sum(fragment.shape.volume for fragment in fragments)
            body, log_spreads = None, None
            if len(fragments) == 1:
                body = self._body(fragments[0].shape)
            elif together:
                body = union_of(fragments)
            else:
                c = found.tree.types[child]
                log_spreads = np.append(self._statistics.log_spreads[c], self._statistics.log_spreads_std[c])
            wanted.append(Wanted(volume, len(fragments), body, log_spreads))
        return wanted

    def _body(self, shape: Mesh | Cloud) -> Body:
        known = self._bodies.get(id(shape))
        if known is None:
            known = self._bodies[id(shape)] = shape, body_of(shape)
        return known[1]


def _refused_planes(now: Configuration, fragment: int, refused: Sequence[Refusal]) -> Floats:
    """(r, 4) the refused cutting planes of this fragment of `now`, in its canonical frame C, their offsets in [m]."""
    X_CW = (now[fragment].X_WF @ canonical_frame(now[fragment].shape)).inverse()
    places = np.array([other.p_WC for other in now])
    planes = [
        refusal.cut.plane_W.transformed(X_CW).to_vector()
        for refusal in refused
        if np.linalg.norm(places - refusal.cut.p_WC[0], axis=1).argmin() == fragment
    ]
    return np.array(planes).reshape(-1, 4)


def voted(result: SearchResult, fragment: int, temperature: float) -> GroundedTree:
    """The best tree with the production that the kept trees vote for, among those that cut the fragment.

    Every tree has the weight exp((log posterior - that of the best) / temperature): the marginal of the production of a
    root over the parse trees that were found.
    """
    best = GroundedTree(result.tree, result.grounding, result.posterior.log)
    if temperature == 0.0:
        return best
    votes: dict[int, float] = {}
    first: dict[int, GroundedTree] = {}
    for found in (best, *result.trees[1:]):
        production = int(found.tree.productions[found.tree.roots[fragment]])
        if production != TERMINAL:
            first.setdefault(production, found)
            weight = float(np.exp((found.log_posterior - best.log_posterior) / temperature))
            votes[production] = votes.get(production, 0.0) + weight
    return first[max(votes, key=lambda production: (votes[production], -production))]


def _planner(context: PlanningContext) -> GrammarPlanner:
    settings = context.settings
    changed = replace(settings, search=replace(settings.search, score_range=settings.plus.score_range))
    return GrammarPlanner(context.model, changed, context.parallel_map, Additions(context.model, changed))


GRAMMAR_PLUS = Method(
    "grammar-plus",
    _planner,
    description="the paper's with volumes in the posterior, and planes chosen by what they make of the goal",
    position=1,
)
