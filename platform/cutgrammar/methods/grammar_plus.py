"""`grammar-plus`: the paper's method with a posterior that plans (see `inference.attributes`, `cutting.plane_choice`).

Each addition is a setting of the table `plus`. The goal's shapes are used in the search only by their features and
volumes; the choice of a plane compares products with the shapes themselves.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.cutting.plane_choice import PlaneWeights, Wanted, choose_plane
from cutgrammar.cutting.planes import draw_planes
from cutgrammar.cutting.virtual_slicing import Body, body_of, union_of
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Fragment, Mesh, vertices_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.type_statistics import TypeStatistics
from cutgrammar.inference.attributes import Attributes
from cutgrammar.inference.parse_tree import TERMINAL, ParseTree
from cutgrammar.interfaces import Refusal
from cutgrammar.methods.grammar import Chosen, GrammarPlanner, Plan
from cutgrammar.methods.method import Method, PlanningContext
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
        self._bodies: dict[int, tuple[Mesh | Cloud, Body]] = {}
        self.n_trees = settings.plus.n_trees

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

    def choose(self, plan: Plan, draws: int, refused: Sequence[Refusal], rng: np.random.Generator) -> Chosen:
        """One production of the parse tree, drawn as in IV-B, and the plane whose virtual products fit best."""
        tree = plan.result.tree
        expanding = tree.productions[tree.roots]
        fragment = int(rng.choice(np.flatnonzero(expanding != TERMINAL)))
        production, z = plan.productions[expanding[fragment]], plan.z_now[fragment]
        wanted = self._wanted(plan, int(tree.roots[fragment]))
        if not self._settings.virtual_slicing or wanted is None:
            return Chosen(fragment, production, self._model.planes.sample(production, z, rng, draws))
        drawn = draw_planes(self._model.planes.mixture(production, z), rng, draws)
        weights = PlaneWeights(self._settings.fit_weight, self._settings.spread_weight, self._settings.adjust_offset)
        scale = scale_of(z)
        avoided = _refused_planes(plan.now[fragment], refused) / np.array([1.0, 1.0, 1.0, scale])
        body = self._body(plan.now[fragment].shape)
        numbers, _ = choose_plane(body, wanted, drawn, scale, weights, avoided)
        return Chosen(fragment, production, Plane(numbers[:3], float(numbers[3])))

    def _wanted(self, plan: Plan, root: int) -> list[Wanted] | None:
        """What the children of a root are to become; None where nothing is grounded below one of them."""
        tree, grounding = plan.result.tree, plan.result.grounding
        together = has_layout(plan.goal)
        wanted = []
        for child in tree.children(root):
            terminals = below(tree, int(child))
            goals = [int(grounding[np.searchsorted(tree.terminals, t)]) for t in terminals]
            fragments = [plan.goal[g] for g in goals if g >= 0]
            if not fragments:
                return None
            volume = sum(fragment.shape.volume for fragment in fragments)
            body, log_spreads = None, None
            if len(fragments) == 1:
                body = self._body(fragments[0].shape)
            elif together:
                body = union_of(fragments)
            else:
                c = tree.types[child]
                log_spreads = np.append(self._statistics.log_spreads[c], self._statistics.log_spreads_std[c])
            wanted.append(Wanted(volume, len(fragments), body, log_spreads))
        return wanted

    def _body(self, shape: Mesh | Cloud) -> Body:
        known = self._bodies.get(id(shape))
        if known is None:
            known = self._bodies[id(shape)] = shape, body_of(shape)
        return known[1]


def _refused_planes(fragment: Fragment, refused: Sequence[Refusal]) -> Floats:
    """(r, 4) the refused cutting planes of this fragment, in its canonical frame C, their offsets in [m]."""
    X_CW = (fragment.X_WF @ canonical_frame(fragment.shape)).inverse()
    planes = [
        refusal.cut.plane_W.transformed(X_CW).to_vector()
        for refusal in refused
        if np.allclose(refusal.cut.p_WC, fragment.p_WC, atol=1e-6)
    ]
    return np.array(planes).reshape(-1, 4)


def below(tree: ParseTree, node: int) -> list[int]:
    """The terminals at or below `node`, ascending."""
    last = node + 1
    while last < len(tree.types) and tree.parents[last] >= node:
        last += 1
    return [t for t in range(node, last) if tree.productions[t] == TERMINAL]


def _planner(context: PlanningContext) -> GrammarPlanner:
    plus = Additions(context.model, context.settings)
    return GrammarPlanner(context.model, context.settings, context.parallel_map, plus)


GRAMMAR_PLUS = Method(
    "grammar-plus",
    _planner,
    description="the paper's with volumes in the posterior, and planes chosen by what they make of the goal",
    position=1,
)
