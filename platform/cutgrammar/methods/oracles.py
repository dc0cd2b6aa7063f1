"""Oracles: the grammar method with parts of its inference replaced by the truth, to tell what each part costs.

They are cumulative, in this order, and each is given the demonstration:

- `oracle-types`: the method, but every fragment's type is the true one: that of the nearest mean, which is what a type
  is to the induction, where the method asks the classifier; another type only where the true ones derive no tree;
- `oracle-parse`: besides, the parse tree is the demonstration's: the production of its next cut, as typed by the true
  types, is carried out on the fragment that stands for the one it cut. The plane is still drawn from the network;
- `oracle-planes`: besides, the demonstrated plane. That is `replay`; what it lacks of a score of 1 is the metric's.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.cutting.planes import draws_left
from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh
from cutgrammar.grammar.production import Production
from cutgrammar.grammar.type_means import nearest_types
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.controls import REPLAY
from cutgrammar.methods.grammar import GrammarPlanner
from cutgrammar.methods.locating import Locator
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.classifier import TypeClassifier

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model

SHARPNESS = 1e-9
"""Temperature of the classifier that is certain of the nearest mean, in units of the features' squared distances."""


def true_types(means: Floats) -> TypeClassifier:
    """A classifier that gives the type of the nearest of the means (k, d) all but the floor.

    The squared distance to a mean m is |z|^2 - 2 m.z + |m|^2, so one linear layer does.
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
        self._types: dict[int, int] = {}

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The demonstration's next production, with a plane drawn anew after a refusal; the goal is not looked at."""
        del goal
        made, found = self._locator.locate(now)
        if made == len(self._locator.cuts):
            return Stuck("no cut applies: the demonstrated parse tree has no further production")
        cut = self._locator.cuts[made]
        if cut.fragment not in found:
            return Stuck(f"no cut applies: fragment {cut.fragment} of the demonstration is not there to be cut")
        fragment = now[found[cut.fragment]]
        z = self._model.features(fragment.shape)
        plane_C = self._model.planes.sample(self._production(cut), z, rng, draws_left(self._draws, len(refused)))
        return Cut(plane_C.transformed(fragment.X_WF @ canonical_frame(fragment.shape)), fragment.p_WC[None])

    def _production(self, cut: DemonstratedCut) -> Production:
        return Production(self._type(cut.fragment), tuple(self._type(product) for product in cut.products))

    def _type(self, fragment: int) -> int:
        if fragment not in self._types:
            shape: Mesh | Cloud = self._demonstration.fragments[fragment].mesh
            self._types[fragment] = int(nearest_types(self._model.features(shape)[None], self._means)[0])
        return self._types[fragment]


def make_types(context: PlanningContext) -> GrammarPlanner:
    """The grammar method with true types; they need no demonstration, but it is an oracle all the same.

    Raises:
        InputError: the model does not hold the means of its types.
    """
    model, settings = context.model, context.settings
    known = dataclasses.replace(model, classifier=true_types(means_of(model)))
    # Where the true types derive no tree, as types never cut in training do, others must be possible at their floor.
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
    "oracle-types", make_types, "grammar with true types", kind="oracle", sees_demonstration=True, position=0
)
ORACLE_PARSE = Method(
    "oracle-parse",
    make_parse,
    "grammar with true types and the demonstrated parse tree",
    kind="oracle",
    sees_demonstration=True,
    position=1,
)
ORACLE_PLANES = Method(
    "oracle-planes",
    REPLAY.make_planner,
    "grammar with true types, the demonstrated parse tree and its planes, which is replay",
    kind="oracle",
    sees_demonstration=True,
    position=2,
)
