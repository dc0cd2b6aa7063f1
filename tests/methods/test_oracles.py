"""The oracles, with a small model of bars whose classifier is always wrong."""

from dataclasses import dataclass, field

import numpy as np
import pytest
import trimesh

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_means import nearest_types, type_means
from cutgrammar.interfaces import Cut
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.oracles import ORACLE_PARSE, ORACLE_PLANES, ORACLE_TYPES, true_types
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.classifier import TypeClassifier
from cutgrammar.seeds import stream
from cutgrammar.settings import SearchSettings, Settings

LENGTHS = (0.16, 0.08, 0.04)
MEANS = np.column_stack([LENGTHS, np.zeros((3, 16))])
SETTINGS = Settings(search=SearchSettings(n_searches=2, max_rounds=20))
HALVES = Grammar(3, {Production(c, (c + 1, c + 1)): 1.0 for c in range(2)}, (1 / 3,) * 3)


class ByLength:
    size = 17

    def __call__(self, shape):
        low, high = extents(shape, canonical_frame(shape))
        return np.append((high - low)[2], np.zeros(16))


@dataclass
class InTheMiddle:
    asked: list = field(default_factory=list)

    def sample(self, production, z, rng, draws):
        self.asked.append((production, float(z[0])))
        return Plane(np.array([0.0, 0.0, 1.0]), rng.normal(0.0, 1e-3))


def always_last():
    return TypeClassifier(3, MLP((np.zeros((17, 3)),), (np.array([0.0, 0.0, 50.0]),)), (0, 1, 2), 1.0)


@dataclass(frozen=True)
class BarModel:
    grammar: Grammar = HALVES
    classifier: TypeClassifier = field(default_factory=always_last)
    planes: InTheMiddle = field(default_factory=InTheMiddle)
    features: ByLength = field(default_factory=ByLength)
    induction: dict = field(default_factory=lambda: {"type_means": MEANS.tolist()})


@pytest.fixture(scope="module")
def halving():
    """A demonstration in which a bar is halved, the upper half first, then the lower one."""
    box = trimesh.creation.box([0.010, 0.012, 0.16]).subdivide()
    whole = Mesh(box.vertices, box.faces)
    up = np.array([0.0, 0.0, 1.0])
    upper, lower = slice_mesh(whole, Plane(up, 0.0)).products
    quarters = [*slice_mesh(upper, Plane(up, -0.04)).products, *slice_mesh(lower, Plane(up, 0.04)).products]
    meshes = [whole, upper, lower, *quarters]
    parents = [None, 0, 0, 1, 1, 2, 2]
    steps = [0, 1, 1, 2, 2, 3, 3]
    alive = [(0,), (1, 2), (2, 3, 4), (3, 4, 5, 6)]
    cuts = [(0, (1, 2), 0.0), (1, (3, 4), -0.04), (2, (5, 6), 0.04)]
    return Demonstration(
        0,
        "N1M1",
        ("bar",),
        ("strips",),
        "hand",
        0,
        tuple(
            DemonstratedFragment(i, p, s, "strips" if i > 2 else None, m)
            for i, (p, s, m) in enumerate(zip(parents, steps, meshes, strict=True))
        ),
        {(step, i): Pose.identity() for step, there in enumerate(alive) for i in there},
        tuple(
            DemonstratedCut(
                step, Plane(up, d), Plane(up, d).transformed(canonical_frame(meshes[i]).inverse()), i, products
            )
            for step, (i, products, d) in enumerate(cuts, 1)
        ),
    )


def test_means_are_of_each_type_and_the_nearest_is_the_true_one(rng):
    features, types = rng.normal(size=(40, 17)), np.arange(40) % 4
    means = type_means(features, types, 4)
    assert means[2] == pytest.approx(features[types == 2].mean(axis=0))
    wanted = [np.argmin([np.linalg.norm(z - mean) for mean in means]) for z in features]
    assert nearest_types(features, means).tolist() == wanted
    with pytest.raises(ValueError, match="type c4 has no fragment"):
        type_means(features, types, 5)


def test_true_types_are_certain_of_the_nearest_mean(rng):
    means, z = 0.05 * rng.normal(size=(6, 17)), 0.05 * rng.normal(size=(30, 17))
    log_p = true_types(means).log_probabilities(z)
    assert log_p.argmax(axis=1).tolist() == nearest_types(z, means).tolist()
    assert log_p.max(axis=1) == pytest.approx(np.zeros(30), abs=1e-5)
    assert np.isfinite(log_p).all()
    assert np.exp(log_p).sum(axis=1) == pytest.approx(np.ones(30))


def test_with_true_types_the_method_plans_where_its_classifier_finds_no_production(halving):
    model = BarModel()
    cut = ORACLE_TYPES.planner(PlanningContext(model, SETTINGS, halving)).next_cut(
        halving.start, halving.goal, [], stream(0)
    )
    assert isinstance(cut, Cut)
    assert cut.explanation.production == "c0 -> c1 c1"
    assert sorted(node.type for node in cut.explanation.tree[1:]) == [0, 1, 1, 2, 2, 2, 2]


def test_the_demonstrated_parse_is_followed_production_by_production(halving):
    model = BarModel()
    oracle = ORACLE_PARSE.planner(PlanningContext(model, SETTINGS, halving))
    for step, cut in enumerate(halving.cuts):
        made = oracle.next_cut(halving.configuration(step), halving.goal, [], stream(step))
        production, length = model.planes.asked[-1]
        parent = 0 if step == 0 else 1
        assert production == Production(parent, (parent + 1, parent + 1))
        assert length == pytest.approx(LENGTHS[parent])
        assert made.p_WC[0] == pytest.approx(halving.fragment_at(step, cut.fragment).p_WC)
        assert made.plane_W.distances(made.p_WC[0]) == pytest.approx(0.0, abs=5e-3)
    assert "no cut applies" in oracle.next_cut(halving.goal, halving.goal, [], stream(0)).reason


def test_the_last_oracle_is_the_replay(halving):
    oracle = ORACLE_PLANES.planner(PlanningContext(BarModel(), SETTINGS, halving))
    assert isinstance(oracle, ReplayPlanner)
    cut = oracle.next_cut(halving.start, halving.goal, [], stream(0))
    assert cut.plane_W.to_vector() == pytest.approx(halving.cuts[0].plane_W.to_vector(), abs=1e-9)


def test_oracles_see_the_demonstration_and_errors_name_what_they_lack(halving):
    assert all(oracle.sees_demonstration for oracle in (ORACLE_TYPES, ORACLE_PARSE, ORACLE_PLANES))
    with pytest.raises(ValueError, match="sees_demonstration"):
        ORACLE_PARSE.planner(PlanningContext(BarModel(), SETTINGS))
    for oracle in (ORACLE_TYPES, ORACLE_PARSE):
        with pytest.raises(InputError, match=r"does not hold the means of its fragment types.*train again"):
            oracle.planner(PlanningContext(BarModel(induction={}), SETTINGS, halving))
