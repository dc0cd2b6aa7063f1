"""`grammar-plus` with a small model whose results are known."""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import pytest
import trimesh

from cutgrammar.cutting.planes import plane_from
from cutgrammar.errors import InputError
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_statistics import type_statistics
from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.posterior import Posterior
from cutgrammar.inference.search import GroundedTree, SearchResult
from cutgrammar.interfaces import Cut, Refusal
from cutgrammar.methods.grammar import GRAMMAR
from cutgrammar.methods.grammar_plus import GRAMMAR_PLUS, Additions, has_layout, statistics_of, voted
from cutgrammar.methods.method import PlanningContext
from cutgrammar.nn.mixture import Mixture
from cutgrammar.seeds import stream
from cutgrammar.settings import PlusSettings, SearchSettings, Settings

LENGTHS = np.array([0.16, 0.12, 0.04])
ENDS = Grammar(3, {Production(0, (1, 2)): 1.0, Production(1, (2, 2)): 0.5, Production(1, (1, 2)): 0.5}, (0.3, 0.3, 0.4))
"""Bars that lose a piece at an end."""


def bar(length, at=0.0, pose=None):
    box = trimesh.creation.box([0.010, 0.012, length]).subdivide()
    return Fragment(Mesh(box.vertices, box.faces), pose or Pose(np.eye(3), np.array([0.0, 0.0, at])))


class ByLength:
    def log_probabilities(self, z):
        raw = -4.0 * np.abs(np.log2(np.exp(z[:, -1:] / 2.0) * 0.02 / LENGTHS))
        return raw - np.log(np.exp(raw).sum(axis=1, keepdims=True))


class Anywhere:
    """Planes across the longest axis, anywhere along it."""

    def mixture(self, production, z):
        return Mixture(np.ones(1), np.array([[0.0, 0.0, 1.0, 0.0]]), np.array([[1e-3, 1e-3, 1e-3, 0.5]]))


def statistics():
    shapes = [bar(length).mesh for length in (*LENGTHS, *LENGTHS)]
    return type_statistics(shapes, np.array([0, 1, 2, 0, 1, 2]), [0, 1, 3, 4], 3)


@dataclass
class FakeModel:
    grammar: Grammar = ENDS
    classifier: ByLength = field(default_factory=ByLength)
    planes: Anywhere = field(default_factory=Anywhere)
    induction: dict = field(default_factory=lambda: {"type_statistics": statistics().to_json()})

    def features(self, shape):
        scale = np.abs(np.array(extents(shape, canonical_frame(shape)))).max()
        return np.append(np.zeros(16), 2.0 * np.log(scale / 0.01))


@pytest.fixture
def settings():
    return Settings(search=SearchSettings(n_searches=2, max_rounds=30))


def planner_of(settings, model=None):
    return GRAMMAR_PLUS.planner(PlanningContext(model or FakeModel(), settings))


def goal_of(lengths, apart=0.0):
    ends = np.cumsum([0.0, *lengths]) + apart * np.arange(len(lengths) + 1)
    return tuple(bar(length, end + length / 2) for length, end in zip(lengths, ends, strict=False))


def cut_of(planner, now, goal, refused=(), attempt=0):
    cut = planner.next_cut(now, goal, refused, stream(0, "test", len(now), attempt))
    assert isinstance(cut, Cut)
    return cut


def carried_out(now, cut):
    chosen = next(i for i, f in enumerate(now) if np.allclose(f.p_WC, cut.p_WC[0]))
    halves = slice_mesh(now[chosen].mesh, cut.plane_W.transformed(now[chosen].X_WF.inverse()))
    assert isinstance(halves, Sliced)
    return now[:chosen] + now[chosen + 1 :] + tuple(Fragment(mesh, now[chosen].X_WF) for mesh in halves.products)


@pytest.mark.parametrize("apart", [0.0, 0.5])
def test_planes_are_laid_where_the_goal_s_fragments_come_out(settings, random_pose, apart):
    lengths = (0.05, 0.03, 0.08)
    planner, now, goal = planner_of(settings), (bar(0.16, pose=random_pose()),), goal_of(lengths, apart)
    for _ in range(2):
        now = carried_out(now, cut_of(planner, now, goal))
    volumes = sorted(f.mesh.volume for f in now)
    np.testing.assert_allclose(volumes, np.sort(lengths) * 0.010 * 0.012, rtol=0.05)


def test_each_object_gets_the_goal_s_fragments_that_come_out_of_it(settings):
    now = (bar(0.16), bar(0.08, at=1.0))
    goal = goal_of((0.06, 0.04, 0.06, 0.035, 0.045), apart=0.5)
    why = cut_of(planner_of(settings), now, goal).explanation
    for i, total in enumerate((0.16, 0.08)):
        root = next(n for n, node in enumerate(why.tree) if node.now == i)
        inside = {root}
        for n, node in enumerate(why.tree):
            if node.parent in inside:
                inside.add(n)
        volume = sum(goal[why.tree[n].goal].mesh.volume for n in inside if why.tree[n].goal is not None)
        assert volume == pytest.approx(total * 0.010 * 0.012, rel=0.15)


def test_the_explanation_holds_the_volume_term(settings):
    why = cut_of(planner_of(settings), (bar(0.16),), goal_of((0.05, 0.03, 0.08))).explanation
    assert why.log_volume is not None
    assert why.log_posterior == pytest.approx(why.log_prior + why.log_shape + why.log_layout + why.log_volume)
    assert why.history[-1] == pytest.approx(why.log_posterior)


def test_only_fragments_that_nearly_touch_have_a_layout(settings):
    assert has_layout(goal_of((0.05, 0.03, 0.08)))
    assert not has_layout(goal_of((0.05, 0.03, 0.08), apart=0.5))
    apart = cut_of(planner_of(settings), (bar(0.16),), goal_of((0.05, 0.03, 0.08), apart=0.5)).explanation
    assert apart.log_layout == 0.0
    counted = dataclasses.replace(settings, plus=PlusSettings(scattered_layout=True))
    apart = cut_of(planner_of(counted), (bar(0.16),), goal_of((0.05, 0.03, 0.08), apart=0.5)).explanation
    assert apart.log_layout < 0.0


def test_plans_repeat(settings):
    now, goal = (bar(0.16),), goal_of((0.05, 0.03, 0.08))
    first, again = (cut_of(planner_of(settings), now, goal) for _ in range(2))
    np.testing.assert_array_equal(first.plane_W.to_vector(), again.plane_W.to_vector())
    assert first.explanation == again.explanation


def test_grammar_reads_none_of_these_settings(settings):
    class Sampled(Anywhere):
        def sample(self, production, z, rng, draws):
            return plane_from(self.mixture(production, z), 0.05, rng, draws)

    now, goal = (bar(0.16),), goal_of((0.05, 0.03, 0.08))
    changed = dataclasses.replace(settings, plus=PlusSettings(volume_weight=0.0, score_range=5.0, whole=False))
    model = FakeModel(planes=Sampled(), induction={})
    cuts = [cut_of(GRAMMAR.planner(PlanningContext(model, given)), now, goal) for given in (settings, changed)]
    assert cuts[0].explanation == cuts[1].explanation
    assert cuts[0].explanation.log_volume is None
    np.testing.assert_array_equal(cuts[0].plane_W.to_vector(), cuts[1].plane_W.to_vector())


def test_all_fragments_are_tried_where_the_best_cut_comes_first(settings):
    first = dataclasses.replace(settings, plus=PlusSettings(best_first=True))
    now, goal = (bar(0.16), bar(0.08, at=1.0)), goal_of((0.06, 0.04, 0.06, 0.035, 0.045), apart=0.5)
    cuts = [cut_of(planner_of(first), now, goal, attempt=attempt) for attempt in range(4)]
    drawn = [cut_of(planner_of(settings), now, goal, attempt=attempt) for attempt in range(8)]
    assert len({tuple(cut.p_WC[0].round(6)) for cut in drawn}) == 2
    assert len({tuple(cut.p_WC[0].round(6)) for cut in cuts}) == 1


def test_after_a_refusal_another_plane_is_chosen_for_the_same_tree(settings):
    planner, now, goal = planner_of(settings), (bar(0.16),), goal_of((0.05, 0.03, 0.08))
    first = cut_of(planner, now, goal)
    second = cut_of(planner, now, goal, [Refusal(first, "grazes")], attempt=1)
    assert second.explanation.tree == first.explanation.tree
    assert abs(second.plane_W.offset - first.plane_W.offset) > 1e-3


def test_clouds_serve_as_goal_and_as_current_fragments(settings):
    def as_clouds(fragments):
        return tuple(Fragment(sample_surface(fragment.mesh, 512), fragment.X_WF) for fragment in fragments)

    now, goal = (bar(0.16),), goal_of((0.05, 0.03, 0.08))
    cut = cut_of(planner_of(settings), as_clouds(now), as_clouds(goal))
    halves = slice_mesh(now[0].mesh, cut.plane_W.transformed(now[0].X_WF.inverse()))
    assert isinstance(halves, Sliced)
    smaller = min(product.volume for product in halves.products) / now[0].mesh.volume
    # One end of 3, 5 or 8 parts of 16 comes off.
    assert min(abs(smaller - parts / 16) for parts in (3, 5, 8)) < 0.03


@pytest.mark.parametrize("change", [{"virtual_slicing": False}, {"adjust_offset": False}])
def test_planes_are_chosen_as_the_settings_say(settings, change):
    class Sampled(Anywhere):
        def sample(self, production, z, rng, draws):
            return plane_from(self.mixture(production, z), 0.05, rng, draws)

    changed = dataclasses.replace(settings, plus=PlusSettings(**change))
    now, goal = (bar(0.16),), goal_of((0.05, 0.03, 0.04, 0.04))
    cut = cut_of(planner_of(changed, FakeModel(planes=Sampled())), now, goal)
    usual = cut_of(planner_of(settings), now, goal)
    assert cut.explanation == usual.explanation
    assert cut.plane_W.offset != usual.plane_W.offset


def test_products_that_are_cut_further_are_compared_with_unions_only_where_there_are_any(settings):
    goal = goal_of((0.05, 0.03, 0.08))
    found = GroundedTree(
        ParseTree(np.array([0, 1, 2, 2, 2]), np.array([-1, 0, 1, 1, 0]), np.array([0, 1, -1, -1, -1])),
        np.array([0, 1, 2]),
        0.0,
    )
    for apart, unions, is_known in ((0.0, True, True), (0.0, False, False), (0.5, True, False)):
        chosen = dataclasses.replace(settings, plus=PlusSettings(union_shapes=unions))
        first, last = Additions(FakeModel(), chosen).wanted(goal_of((0.05, 0.03, 0.08), apart), found, np.array([1, 4]))
        assert (first.body is not None) is is_known
        assert (first.log_spreads is None) is is_known
        assert last.body is not None
        assert (first.count, first.volume) == (2, pytest.approx(sum(f.mesh.volume for f in goal[:2])))


def test_each_term_can_be_left_out():
    now, goal = (bar(0.16),), goal_of((0.05, 0.03, 0.04, 0.04))

    def attributes(**changes):
        return Additions(FakeModel(), Settings(plus=PlusSettings(**changes))).attributes(now, goal)

    usual = attributes()
    assert usual.volume_weight > 0.0 < usual.conservation
    np.testing.assert_allclose(np.exp(usual.log_whole), statistics().whole)
    assert usual.swap_types
    assert attributes(volume_weight=0.0).volume_weight == 0.0
    assert attributes(conservation=0.0).conservation == 0.0
    assert attributes(whole=False).log_whole is None
    assert not attributes(swap_types=False).swap_types


def test_a_model_without_statistics_is_refused(settings):
    with pytest.raises(InputError, match="train again"):
        statistics_of(FakeModel(induction={}))


def test_the_kept_trees_vote_for_the_production(rng):
    def found(production, log):
        tree = ParseTree(np.array([0, 1, 2]), np.array([-1, 0, 0]), np.array([production, -1, -1]))
        return GroundedTree(tree, np.array([0, 1]), log)

    trees = (found(0, -1.0), found(1, -1.5), found(1, -1.6))
    result = SearchResult(trees[0].tree, trees[0].grounding, Posterior(-1.0, 0.0, 0.0), 0, (), 3, 0, trees)
    assert voted(result, 0, 1.0) is trees[1]
    assert voted(result, 0, 0.1).tree is trees[0].tree
    assert voted(result, 0, 0.0).tree is trees[0].tree
