"""The figures of the grammar, the paper and the training contain all their texts."""

from types import SimpleNamespace

import numpy as np
import pytest

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.events import CutMade, Planned, Scored
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar_dashboards.figures.curves import draw_induction, draw_losses
from cutgrammar_dashboards.figures.data_picture import draw_data
from cutgrammar_dashboards.figures.grammar_picture import draw_grammar
from cutgrammar_dashboards.figures.inference_picture import Inference, draw_inference
from cutgrammar_dashboards.figures.layout.tree_picture import production_of
from cutgrammar_dashboards.figures.matching_picture import draw_matching
from cutgrammar_dashboards.figures.methods_picture import MethodResult, TrialResults, draw_methods
from cutgrammar_dashboards.figures.sharing_picture import Side, demonstrated_tree, draw_sharing


def texts(figure):
    return [text.get_text() for ax in figure.axes for text in ax.texts]


@pytest.fixture
def grammar():
    options = {Production(5, (0, 4)): 0.6, Production(5, (0, 1, 2)): 0.4, Production(4, (1, 2)): 1.0}
    options |= {Production(4, (1, 4)): 0.25, Production(4, (1, 2)): 0.75}
    return Grammar(6, options, (0.2, 0.2, 0.2, 0.1, 0.1, 0.2))


@pytest.fixture
def typical(story):
    start, goal, _ = story
    shapes = [goal[i % 4].mesh for i in range(5)] + [start[0].mesh]
    return [SimpleNamespace(mesh=mesh, trial=0, count=3, length=0.01 * (i + 1)) for i, mesh in enumerate(shapes)]


@pytest.fixture
def trial(story):
    start, goal, events = story
    scored = events[-1]
    assert isinstance(scored, Scored)
    full = MethodResult("grammar", events[-2].configuration, scored.pairs, scored.iou_strict, "done")
    early = MethodResult("random", start, ((0, 2, 0.25),), 0.0625, "stuck")
    return TrialResults("N1M1", "trial 7", start, goal, (full, early))


@pytest.fixture
def demonstration(story):
    start, goal, _ = story
    fragments = [DemonstratedFragment(0, None, 0, None, start[0].mesh)]
    fragments += [DemonstratedFragment(i + 1, 0, 1, "chunks", fragment.mesh) for i, fragment in enumerate(goal)]
    plane = Plane(np.array([1.0, 0.0, 0.0]), 0.0)
    cuts = (
        DemonstratedCut(1, plane, plane, 0, (1, 2), undone=True),
        DemonstratedCut(2, plane, plane, 0, (1, 2, 3, 4)),
    )
    poses = {(0, 0): Pose.identity()} | {(1, i): Pose.identity() for i in range(1, 5)}
    return Demonstration(3, "N1M1", ("carrot",), ("chunks",), "by hand", 0, tuple(fragments), poses, cuts)


def test_every_type_and_every_production_of_a_grammar_is_drawn(grammar, typical):
    said = texts(draw_grammar(grammar, typical, "a grammar"))
    assert {f"c{c}" for c in range(6)} <= set(said)
    assert sorted(text for text in said if text in (".60", ".40", ".75", ".25")) == [".25", ".40", ".60", ".75"]
    assert "never cut" in said
    assert sum(text == "c1" for text in said) == 1 + 3  # itself, and as a child of three productions
    assert "10 mm" in said


def test_a_large_grammar_keeps_its_types_apart(typical):
    k = 40
    options = {Production(c, (c + 1, d)): 0.5 for c in range(20) for d in (30, 39)}
    figure = draw_grammar(Grammar(k, options, (1 / k,) * k), [typical[c % 6] for c in range(k)], "large")
    bold = [text for text in figure.axes[0].texts if text.get_fontweight() == "bold" and text.get_text()[0] == "c"]
    assert len(bold) == k
    places = np.array([text.get_position() for text in bold])
    apart = np.abs(places[:, None] - places[None]) + 9.0 * np.eye(k)[..., None]
    assert ((apart[..., 0] > 0.5) | (apart[..., 1] > 0.4)).all()
    assert places[:, 0].max() < figure.get_figwidth()
    assert places[:, 1].max() < figure.get_figheight()


def test_methods_are_side_by_side_with_their_scores(trial):
    said = texts(draw_methods([trial, trial], "methods"))
    assert {"start", "goal", "grammar", "random", "N1M1"} <= set(said)
    assert said.count("0.06") == 2
    assert "1 of 4, stuck" in said


def test_a_method_without_a_result_leaves_a_gap(trial):
    alone = TrialResults("N2M1", "trial 9", trial.start, trial.goal, trial.results[1:])
    assert texts(draw_methods([trial, alone], "methods")).count("–") == 1


def test_matched_pairs_are_joined_and_the_unmatched_are_shown_without_a_number(trial):
    early = TrialResults("N1M1", "trial 7", trial.start, trial.goal, trial.results[1:])
    figure = draw_matching(early, "pairs", 9)
    said = texts(figure)
    assert said.count("0.25") == 1
    assert any("1 matched pairs, best first; 4 fragments in the goal, 1 reached" in text for text in said)
    assert len(figure.axes[0].images) == 4 + 1


def test_an_inference_shows_types_grounding_search_and_cut(story, grammar, typical):
    start, goal, events = story
    planned, made = next(e for e in events if isinstance(e, Planned)), next(e for e in events if isinstance(e, CutMade))
    even = np.full(6, np.log(1 / 6))
    why = planned.cut.explanation
    shown = Inference(
        start, goal, even[None], np.tile(even, (4, 1)), planned.cut, why, made.configuration, grammar, typical
    )
    figure = draw_inference(shown, "one")
    said = texts(figure)
    assert {"S", "#0: c5", "g0", "g1", "g2", "g3"} <= set(said)
    assert sum(text in ("g0", "g1", "g2", "g3") for text in said) == 8  # in p(c|z) and under their terminals
    assert "the production drawn, c5 → c0 c4, and its cutting plane" in said
    assert ".60" in said
    assert any(text.startswith("log posterior -27.8") for text in said)


def test_the_parse_tree_of_a_demonstration_leaves_out_undone_cuts(demonstration):
    drawn = demonstrated_tree(demonstration, [5, 0, 1, 1, 2])
    assert [node.type for node in drawn.tree] == [None, 5, 0, 1, 1, 2]
    assert production_of(drawn.tree, 1) == Production(5, (0, 1, 1, 2))
    assert production_of(drawn.tree, 0) is None
    assert (drawn.leaves, drawn.depth) == (4, 2)


def test_two_parse_trees_show_the_production_that_they_share(demonstration):
    drawn = demonstrated_tree(demonstration, [5, 0, 1, 1, 2])
    shared = Production(5, (0, 1, 1, 2))
    sides = [
        Side(name, "", drawn, demonstration.start, demonstration.goal) for name in ("seen: carrot", "planned: potato")
    ]
    said = texts(draw_sharing(*sides, shared, "shared"))
    assert "The production c5 → c0 c1 c1 c2 is in both" in said
    assert {"seen: carrot", "planned: potato"} <= set(said)


def test_demonstrations_are_drawn_by_setup(demonstration):
    said = texts(draw_data({"N1M1": [demonstration], "N2M1": [demonstration]}, "data"))
    assert {"N1M1", "N2M1", "chunks", "slices", "cubes", "strips", "carrot"} <= set(said)


@pytest.mark.parametrize("setups", [["N1M1"], ["N1M1", "N2M1"], ["N1M1", "N2M1", "N2M2"]])
def test_the_heading_of_few_setups_has_room_beside_the_legend(demonstration, setups):
    figure = draw_data(dict.fromkeys(setups, [demonstration] * 3), "Demonstrations of data-recorded, by setup")
    drawn = {text.get_text(): text.get_window_extent() for text in figure.axes[0].texts}
    assert drawn["Demonstrations of data-recorded, by setup"].x1 < drawn["chunks"].x0
    assert drawn["strips"].x1 < figure.bbox.x1


def test_curves_show_the_chosen_number_of_types_and_leave_out_unknown_scores():
    curve = [
        {"k": k, "objective_mean": -100.0 / k, "objective_std": 1.0, "held_out_mean": None, "productions_mean": 2.0 * k}
        for k in range(1, 12)
    ]
    figure = draw_induction(curve, 7, "induction")
    assert len(figure.axes) == 1 + 2
    assert any(text.startswith("the dashed line is the number of types chosen, 7") for text in texts(figure))
    losses = draw_losses({"encoder": [(1, 0.7), (2, 0.4), (3, 0.5)], "planes": []}, "losses")
    assert "0.4 after 2" in texts(losses)


@pytest.mark.filterwarnings("error")
def test_a_curve_with_one_value_has_limits_on_both_sides_of_it():
    curve = [{"k": k, "objective_mean": -5.0 if k < 6 else -1.0, "objective_std": 0.0} for k in range(1, 7)]
    low, high = draw_induction(curve, 6, "induction").axes[1].get_ylim()
    assert low < -1.0 < high
