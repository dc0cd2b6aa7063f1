"""What holds for every method that is installed, whatever it does."""

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.cutting.planes import PlaneNetwork
from cutgrammar.demonstration import objects_of
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_means import nearest_types
from cutgrammar.grammar.type_statistics import type_statistics
from cutgrammar.interfaces import Cut
from cutgrammar.learning.model import Model, Provenance
from cutgrammar.methods.locating import measures
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.oracles import true_types
from cutgrammar.methods.registry import installed_methods
from cutgrammar.nn.mixture import numbers_of
from cutgrammar.nn.mlp import MLP
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.perception.feature import STEPS, UNIT
from cutgrammar.perception.vision.completion import complete
from cutgrammar.seeds import stream
from cutgrammar.settings import CuttingSettings, FittingSettings, SearchSettings, Settings
from cutgrammar.trials.goals import GOALS, goal_for
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.perceived import scanned_goal

SETTINGS = Settings(
    search=SearchSettings(n_searches=1, max_rounds=5),
    cutting=CuttingSettings(n_draws=2),
    fitting=FittingSettings(evaluations=20, n_starts=1, max_points=1000),
)
METHODS = {method.name: method for method in installed_methods()}
NAMES = sorted(METHODS)
SEEING = {name for name in NAMES if METHODS[name].sees_demonstration}
K, DRAWS = 3, 40


@lru_cache
def demonstration():
    made_of = {name: getattr(foods, name) for name in foods.PROPORTIONS}
    return make_demonstration(4, SETUPS["N2M1"], ("chunks",), made_of, 0, SETTINGS.demonstrator)


class ByBox:
    """Features that neither pose nor meshing changes: extents and scale."""

    size = 17

    def __call__(self, shape):
        numbers = measures(shape)
        return np.concatenate([numbers / numbers[3], np.zeros(12), [STEPS * np.log(numbers[3] / UNIT)]])


@lru_cache
def model():
    """A model whose types go by size and whose networks have random weights."""
    rng = np.random.default_rng(0)

    def network(*sizes):
        shapes = list(pairwise(sizes))
        return MLP(tuple(rng.normal(size=s) / np.sqrt(s[0]) for s in shapes), tuple(np.zeros(n) for _, n in shapes))

    of = demonstration()
    z = np.array([ByBox()(fragment.mesh) for fragment in of.fragments])
    means = z[[0, len(z) // 2, -1]]
    types = nearest_types(z, means)
    statistics = type_statistics([f.mesh for f in of.fragments], types, [cut.fragment for cut in of.cuts], K)
    known = {Production(c, (a, b)) for c in range(K) for a in range(K) for b in range(a, K)}
    return Model(
        settings=SETTINGS,
        features=ByBox(),
        classifier=true_types(means),
        grammar=Grammar(
            K, dict.fromkeys(sorted(known), K / len(known)), tuple((np.bincount(types, minlength=K) + 1) / (len(z) + K))
        ),
        planes=PlaneNetwork(K, 3, 0.02, network(2 * K + 17, 8, numbers_of(3, 4))),
        policy=SetNetwork(network(17, 8, 4), network(17 + 2 * 4, 8, 1)),
        values=SetNetwork(network(17, 8, 4), network(17 + 2 * 4, 8, 1)),
        goal_planes=GoalPlaneNetwork(3, 0.02, SetNetwork(network(17, 8, 4), network(17 + 4, 8, numbers_of(3, 4)))),
        provenance=Provenance("data", "paper", "split", (), 0),
        induction={"type_means": means.tolist(), "type_statistics": statistics.to_json()},
    )


def planner_called(name):
    of = demonstration()
    return METHODS[name].planner(PlanningContext(model(), SETTINGS, of, donors=objects_of(of), reproduction=of))


def situation(name):
    """Fragments half cut, and the goal that the method is tried on."""
    of = demonstration()
    condition = [goals for goals in ("foreign", "in-place", "scattered") if METHODS[name].applies_to(goals)][-1]
    return of.configuration(of.steps // 2), goal_for(of, condition, stream(0, "goal"), objects_of(of))


def rewritten(goal, rng, remeshed):
    """The same goal in another order and with other meshes."""
    return tuple(
        Fragment(remeshed(goal[i].mesh, Pose.identity()), goal[i].X_WF) for i in rng.permutation(len(goal)).tolist()
    )


def numbers(cut):
    return np.concatenate([cut.plane_W.to_vector(), cut.p_WC.ravel()])


def test_only_methods_that_repeat_a_demonstration_are_given_one():
    assert {"expert", "expert-rough", "oracle-parse", "oracle-planes", "oracle-types", "replay", "transfer"} == SEEING


def test_methods_declare_known_goals():
    assert all(set(method.goals or GOALS) <= set(GOALS) for method in METHODS.values())
    limited = {name: METHODS[name].goals for name in NAMES if METHODS[name].goals is not None}
    assert limited == {
        "copy": ("in-place",),
        "human": ("in-place",),
        "oracle-parse": ("in-place", "scattered"),
        "oracle-planes": ("in-place", "scattered"),
        "transfer": ("foreign", "foreign-food"),
    }


@pytest.mark.parametrize("name", NAMES)
def test_a_method_repeats_itself_and_cuts_a_current_fragment(name):
    now, goal = situation(name)
    cuts = [planner_called(name).next_cut(now, goal, [], stream(1, name)) for _ in range(2)]
    assert all(isinstance(cut, Cut) for cut in cuts)
    assert np.array_equal(*map(numbers, cuts))
    assert any(np.array_equal(cuts[0].p_WC[0], fragment.p_WC) for fragment in now)


@pytest.mark.parametrize("name", NAMES)
def test_a_method_plans_from_completed_clouds(name):
    now, goal = situation(name)
    seen = []
    for fragment in now:
        cloud = sample_surface(fragment.mesh.moved(fragment.X_WF), 2000)
        above = cloud.normals[:, 2] > -0.5
        seen.append(Fragment(complete(cloud.points[above], cloud.normals[above]), Pose.identity()))
    cut = planner_called(name).next_cut(tuple(seen), scanned_goal(goal), [], stream(1, name))
    assert isinstance(cut, Cut)
    assert any(np.array_equal(cut.p_WC[0], fragment.p_WC) for fragment in seen)


@pytest.mark.parametrize("name", NAMES)
def test_cuts_do_not_depend_on_the_goal_s_order_or_meshes(name, rng, remeshed):
    now, goal = situation(name)
    other = rewritten(goal, rng, remeshed)
    for seed in range(3):
        first, second = (planner_called(name).next_cut(now, given, [], stream(seed)) for given in (goal, other))
        assert numbers(first) == pytest.approx(numbers(second), abs=1e-6)


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"copy"} - (SEEING - {"oracle-types"})))
def test_moving_the_goal_does_not_change_the_distribution_of_cuts(name, random_pose):
    """Which fragment is cut, and how far from its centroid, has the same distribution.

    `copy` uses the place of the goal. Of the methods that see the demonstration, only `oracle-types` uses the goal.
    """
    now, goal = situation(name)
    X = random_pose()
    elsewhere = tuple(Fragment(fragment.shape, X @ fragment.X_WF) for fragment in goal)
    seen = []
    for given in (goal, elsewhere):
        planner = planner_called(name)
        cuts = [planner.next_cut(now, given, [], stream(seed)) for seed in range(DRAWS)]
        which = [next(i for i, f in enumerate(now) if np.array_equal(f.p_WC, cut.p_WC[0])) for cut in cuts]
        seen.append((np.bincount(which, minlength=len(now)), [c.plane_W.distances(c.p_WC)[0] for c in cuts]))
    (chosen, offsets), (others, other_offsets) = seen
    error = np.sqrt((chosen + others) / 2 * (1 - (chosen + others) / (2 * DRAWS)) * 2) + 1e-9
    assert np.all(np.abs(chosen - others) <= 4.0 * error)
    spread = np.sqrt((np.var(offsets) + np.var(other_offsets)) / DRAWS) + 1e-9
    assert abs(np.mean(offsets) - np.mean(other_offsets)) <= 4.0 * spread
