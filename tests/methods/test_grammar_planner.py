"""The paper's planner, with a small model whose results are known."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.grammar import GrammarPlanner
from cutgrammar.seeds import stream
from cutgrammar.settings import SearchSettings, Settings

LENGTHS = np.array([0.16, 0.08, 0.04, 0.02])
HALVES = Grammar(4, {Production(c, (c + 1, c + 1)): 1.0 for c in range(3)}, (0.25,) * 4)
"""Bars that are halved three times."""


class ByLength:
    def log_probabilities(self, z):
        raw = -4.0 * np.abs(np.log2(z[:, :1] / LENGTHS))
        return raw - np.log(np.exp(raw).sum(axis=1, keepdims=True))


class InTheMiddle:
    """Planes across the longest axis, near the middle."""

    def sample(self, production, z, rng, draws):
        return Plane(np.array([0.0, 0.0, 1.0]), rng.normal(0.0, 1e-4))


@dataclass
class FakeModel:
    grammar: Grammar = HALVES
    classifier: ByLength = field(default_factory=ByLength)
    planes: InTheMiddle = field(default_factory=InTheMiddle)
    n_computed: int = 0

    def features(self, shape):
        self.n_computed += 1
        low, high = extents(shape, canonical_frame(shape))
        return np.append((high - low)[2], np.zeros(16))


def bar(length, at=0.0, pose=None):
    box = trimesh.creation.box([length, 0.010, 0.012]).subdivide()
    return Fragment(Mesh(box.vertices, box.faces), pose or Pose(np.eye(3), np.array([at, 0.0, 0.0])))


def bars(length, count):
    return tuple(bar(length, at=length * (i - (count - 1) / 2)) for i in range(count))


@pytest.fixture
def settings():
    return Settings(search=SearchSettings(n_searches=2, max_rounds=20))


def cut_of(planner, now, goal, refused=(), attempt=0):
    return planner.next_cut(now, goal, refused, stream(0, "test", len(now), attempt))


def numbers(cut):
    return (*cut.plane_W.to_vector(), *cut.p_WC.ravel())


def test_a_bar_is_cut_into_the_goal_s_bars_step_by_step(settings, random_pose):
    planner = GrammarPlanner(FakeModel(), settings)
    now, goal = (bar(0.16, pose=random_pose()),), bars(0.04, 4)
    for step in range(3):
        cut = cut_of(planner, now, goal)
        assert isinstance(cut, Cut)
        assert cut.explanation.production == ("c0 -> c1 c1" if step == 0 else "c1 -> c2 c2")
        assert not cut.explanation.dead_end
        chosen = next(i for i, f in enumerate(now) if np.allclose(f.p_WC, cut.p_WC[0]))
        halves = slice_mesh(now[chosen].mesh, cut.plane_W.transformed(now[chosen].X_WF.inverse()))
        assert isinstance(halves, Sliced)
        products = tuple(Fragment(mesh, now[chosen].X_WF) for mesh in halves.products)
        now = now[:chosen] + now[chosen + 1 :] + products
    assert sorted(round(f.mesh.volume / goal[0].mesh.volume, 1) for f in now) == [1.0] * 4
    assert isinstance(cut_of(planner, now, goal), Stuck)


def test_the_explanation_is_a_tree_grounded_in_the_goal(settings):
    now, goal = bars(0.08, 2), bars(0.04, 4)
    why = cut_of(GrammarPlanner(FakeModel(), settings), now, goal).explanation
    assert why.tree[0].type is None
    assert [node.now for node in why.tree if node.parent == 0] == [0, 1]
    assert sorted(node.goal for node in why.tree if node.goal is not None) == [0, 1, 2, 3]
    assert all(node.parent < i for i, node in enumerate(why.tree) if node.parent is not None)
    parents = {node.parent for node in why.tree}
    assert all((node.goal is None) == (i in parents) for i, node in enumerate(why.tree))
    for root in (1, next(i for i, node in enumerate(why.tree) if node.now == 1)):
        grounded = sorted(node.goal for node in why.tree if node.parent == root)
        assert grounded in ([0, 1], [2, 3])  # the layout keeps neighbours together
    assert why.history[-1] == pytest.approx(why.log_posterior)
    assert why.rollouts > 0 == why.dead_ends


def test_plans_repeat_and_do_not_depend_on_where_searches_run(settings):
    now, goal = bars(0.08, 2), bars(0.02, 8)

    def threads(function, arguments):
        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(function, arguments))

    first = cut_of(GrammarPlanner(FakeModel(), settings), now, goal)
    again = cut_of(GrammarPlanner(FakeModel(), settings, parallel_map=threads), now, goal)
    assert numbers(first) == numbers(again)
    assert first.explanation == again.explanation


def test_after_a_refusal_the_parse_tree_is_kept_and_the_plane_drawn_anew(settings):
    searches = []

    def counting(function, arguments):
        searches.append(list(arguments))
        return [function(argument) for argument in searches[-1]]

    planner = GrammarPlanner(FakeModel(), settings, parallel_map=counting)
    now, goal = bars(0.08, 2), bars(0.02, 8)
    first = cut_of(planner, now, goal)
    second = cut_of(planner, now, goal, [Refusal(first, "grazes")], attempt=1)
    assert len(searches) == 1
    assert second.explanation.tree == first.explanation.tree
    assert numbers(second) != numbers(first)
    cut_of(planner, bars(0.08, 3), goal, [Refusal(first, "grazes")], attempt=1)
    assert len(searches) == 2


def test_any_production_of_a_current_fragment_may_come_first(settings):
    planner = GrammarPlanner(FakeModel(), settings)
    now, goal = bars(0.08, 2), bars(0.02, 8)
    cuts = [cut_of(planner, now, goal, attempt=attempt) for attempt in range(12)]
    assert len({tuple(cut.p_WC[0].round(6)) for cut in cuts}) == 2


def test_the_feature_of_each_shape_is_computed_once(settings):
    model = FakeModel()
    planner = GrammarPlanner(model, settings)
    now, goal = bars(0.08, 2), bars(0.04, 4)
    cut_of(planner, now, goal)
    assert model.n_computed == 6
    moved = tuple(Fragment(fragment.shape, Pose(np.eye(3), np.array([0.0, 1.0, i]))) for i, fragment in enumerate(now))
    cut_of(planner, moved, goal)
    assert model.n_computed == 6


def test_clouds_serve_as_goal_and_as_current_fragments(settings):
    def as_clouds(fragments):
        return tuple(Fragment(sample_surface(fragment.mesh, 512), fragment.X_WF) for fragment in fragments)

    now, goal = as_clouds(bars(0.16, 1)), as_clouds(bars(0.04, 4))
    assert all(isinstance(fragment.shape, Cloud) for fragment in now + goal)
    cut = cut_of(GrammarPlanner(FakeModel(), settings), now, goal)
    assert cut.explanation.production == "c0 -> c1 c1"


def test_enough_fragments_end_the_plan(settings):
    answer = cut_of(GrammarPlanner(FakeModel(), settings), bars(0.04, 4), bars(0.04, 4))
    assert answer == Stuck("there are 4 fragments already and the goal has 4")


def test_where_no_production_applies_the_planner_names_the_possible_types():
    settings = Settings(search=SearchSettings(min_type_probability=0.5))
    answer = cut_of(GrammarPlanner(FakeModel(), settings), bars(0.02, 1), bars(0.01, 2))
    assert isinstance(answer, Stuck)
    assert "can only be of types c3" in answer.reason
    assert "search.min_type_probability (0.5)" in answer.reason


def test_a_plan_for_an_unreachable_goal_is_marked_as_a_dead_end():
    settings = Settings(search=SearchSettings(n_searches=2, max_rounds=20, min_type_probability=0.5))
    cut = cut_of(GrammarPlanner(FakeModel(), settings), bars(0.16, 1), bars(0.01, 16))
    assert cut.explanation.dead_end
    assert cut.explanation.dead_ends == cut.explanation.rollouts
    assert len([node for node in cut.explanation.tree if node.goal is not None]) == 8
