"""Oracles: the grammar method with parts of its inference replaced by the truth, to measure what each part costs.

Each replaces the parts that the one before it replaces, and one more:

- `oracle-types`: the types of fragments. The true type is that of the nearest mean, as in the induction, where the
  method uses the classifier. Other types are possible only where the true ones derive no parse tree.
- `oracle-parse`: the parse tree. The production of the demonstration's next cut, with the true types, is carried out on
  the current fragment that corresponds to the demonstrated one. The plane is still drawn from the network.
- `oracle-planes`: the cutting plane. That is `replay`; the difference of its score from 1 is due to the metric.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.cutting.planes import draws_left
from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.grammar.production import Production
from cutgrammar.grammar.type_means import nearest_types
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.controls import REPLAY
from cutgrammar.methods.grammar import GrammarPlanner
from cutgrammar.methods.locating import Locator
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.methods.shape_cache import ShapeCache
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.classifier import TypeClassifier

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model

OWN_GOALS = ("in-place", "scattered")
"""The goals that the demonstration leads to; against another individual's goal it is not the truth."""
SHARPNESS = 1e-9
"""Temperature of the classifier that is certain of the nearest mean, in units of squared feature distances."""


def true_types(means: Floats) -> TypeClassifier:
    """A classifier that gives the type of the nearest of the means (k, d) all probability but the floor.

    The squared distance to a mean m is |z|^2 - 2 m.z + |m|^2, so one linear layer suffices.
    """
    k = len(means)
    layers = MLP((np.ascontiguousarray(2.0 * means.T),), (-(means**2).sum(axis=1),))
    return TypeClassifier(k, layers, tuple(range(k)), SHARPNESS)


def means_of(model: "Model") -> Floats:
    """(k, d) mean feature of each type, as the model holds them.

    Raises:
        InputError: the model was trained by a version that did not keep them.
    """
    means = np.array(model.induction.get("type_means", ()), dtype=np.float64)
    if means.shape != (model.grammar.k, model.features.size):
        raise InputError("the model does not hold the means of its fragment types, which oracles need; train again")
    return means


class ParseOracle:
    """Carries out the productions of the demonstrated parse tree, with planes from the network."""

    def __init__(self, model: "Model", demonstration: Demonstration, draws: int) -> None:
        self._model = model
        self._draws = draws
        self._means = means_of(model)
        self._demonstration = demonstration
        self._locator = Locator(demonstration)
        self._features = ShapeCache(model.features)

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next production, with a plane drawn anew after a refusal; the goal is ignored."""
        del goal
        following = self._locator.next_cut(now, "the demonstrated parse tree has no further production")
        if isinstance(following, Stuck):
            return Stuck(f"no cut applies: {following.reason}")
        fragment = following.fragment
        z = self._features((fragment,))[0][0]
        draws = draws_left(self._draws, len(refused))
        plane_C = self._model.planes.sample(self._production(following.cut), z, rng, draws)
        return Cut.of_fragment(fragment, plane_C, canonical_frame(fragment.shape))

    def _production(self, cut: DemonstratedCut) -> Production:
        return Production(self._types[cut.fragment], tuple(self._types[product] for product in cut.products))

    @cached_property
    def _types(self) -> dict[int, int]:
        """The true type of every fragment of the demonstration, by id."""
        z = np.array([self._model.features(fragment.mesh) for fragment in self._demonstration.fragments])
        types = nearest_types(z, self._means).tolist()
        return {fragment.id: c for fragment, c in zip(self._demonstration.fragments, types, strict=True)}


def make_types(context: PlanningContext) -> GrammarPlanner:
    """The grammar method with true types. They need no demonstration, but no planner could know them.

    Raises:
        InputError: the model does not hold the means of its types.
    """
    model, settings = context.model, context.settings
    known = dataclasses.replace(model, classifier=true_types(means_of(model)))
    # Types that were never cut in training derive no tree; other types must then be possible, at their floor.
    search = dataclasses.replace(settings.search, min_type_probability=0.0)
    return GrammarPlanner(known, dataclasses.replace(settings, search=search), context.parallel_map)


def make_parse(context: PlanningContext) -> ParseOracle:
    """True types and the demonstrated parse tree.

    Raises:
        InputError: the model does not hold the means of its types.
        ValueError: no demonstration.
    """
    return ParseOracle(context.model, context.require_demonstration(), context.settings.cutting.n_draws)


ORACLE_TYPES = Method(
    "oracle-types",
    make_types,
    description="grammar with true types",
    kind="oracle",
    sees_demonstration=True,
    position=0,
)
ORACLE_PARSE = Method(
    "oracle-parse",
    make_parse,
    description="grammar with true types and the demonstrated parse tree",
    kind="oracle",
    sees_demonstration=True,
    goals=OWN_GOALS,
    position=1,
)
ORACLE_PLANES = Method(
    "oracle-planes",
    REPLAY.make_planner,
    description="grammar with true types, the demonstrated parse tree and its planes, which is replay",
    kind="oracle",
    sees_demonstration=True,
    goals=OWN_GOALS,
    position=2,
)
