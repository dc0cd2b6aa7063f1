"""`guided` on bars with a small model: every source of starting plans, all steps of a trial, refusals and clouds."""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import pytest
import trimesh

from cutgrammar.cutting.planes import plane_from
from cutgrammar.fitting.plan_tree import goals_of
from cutgrammar.fitting.targets import targets_of
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.canonical import canonical_frame, extents
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_statistics import type_statistics
from cutgrammar.interfaces import Cut, Refusal, Stuck, run_serially
from cutgrammar.methods.guided import GUIDED
from cutgrammar.methods.guided_structures import GrammarPlans, shuffled, uniform
from cutgrammar.methods.method import PlanningContext
from cutgrammar.nn.mixture import Mixture
from cutgrammar.seeds import stream
from cutgrammar.settings import FittingLevel, FittingSettings, SearchSettings, Settings
from cutgrammar.trials.run_trial import run_trial
from cutgrammar_sim.worlds.bench import Bench

LENGTHS = np.array([0.16, 0.12, 0.04])
ENDS = Grammar(3, {Production(0, (1, 2)): 1.0, Production(1, (2, 2)): 0.5, Production(1, (1, 2)): 0.5}, (0.3, 0.3, 0.4))
SOURCES = ("grammar", "uniform", "shuffled", "halve", "peel")
LEVELS = (
    FittingLevel(40, 0, 0.3, 0.12, 0.8),
    FittingLevel(80, 80, 0.15, 0.04, 0.8),
    FittingLevel(200, 200, 0.3, 0.012, 0.3),
)
GOAL = (0.06, 0.045, 0.03, 0.025)


def bar(length, at=0.0):
    box = trimesh.creation.box([0.010, 0.014, length]).subdivide()
    return Fragment(Mesh(box.vertices, box.faces), Pose(np.eye(3), np.array([0.0, 0.0, at])))


def goal_of(lengths):
    return tuple(bar(length, 0.3 * i) for i, length in enumerate(lengths))


class ByLength:
    def log_probabilities(self, z):
        raw = -4.0 * np.abs(np.log2(np.exp(z[:, -1:] / 2.0) * 0.02 / LENGTHS))
        return raw - np.log(np.exp(raw).sum(axis=1, keepdims=True))


class Anywhere:
    """Planes across the longest axis, anywhere along it."""

    def sample(self, production, z, rng, draws=1):
        mixture = Mixture(np.ones(1), np.array([[0.0, 0.0, 1.0, 0.0]]), np.array([[1e-3, 1e-3, 1e-3, 0.5]]))
        return plane_from(mixture, 0.1, rng, draws)


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


def settings_of(**changes):
    small = {"evaluations": 1500, "n_starts": 2, "levels": LEVELS}
    return Settings(search=SearchSettings(n_searches=1, max_rounds=20), fitting=FittingSettings(**(small | changes)))


def planner_of(**changes):
    return GUIDED.planner(PlanningContext(FakeModel(), settings_of(**changes)))


def played(planner, start, goal, seed=0):
    world = Bench(1e-3)
    events = run_trial(start, goal, planner, world, [], lambda *names: stream(seed, *names), Settings().trial)
    return events[-1].scores["iou_strict"], events


@pytest.mark.parametrize("source", SOURCES)
def test_a_bar_is_cut_as_the_goal_wants_from_every_source_of_starting_plans(source):
    score, events = played(planner_of(structures=source), (bar(0.16),), goal_of(GOAL))
    assert score > 0.93
    assert len([event for event in events if isinstance(event, type(events[0]))]) == 3


def test_several_bars_are_cut_together():
    score, _ = played(planner_of(evaluations=4000), (bar(0.16), bar(0.1, 0.5)), goal_of((*GOAL, 0.07, 0.03)))
    assert score > 0.9


def test_the_same_stream_gives_the_same_cuts():
    first, second = (played(planner_of(), (bar(0.16),), goal_of(GOAL), seed=3)[1] for _ in range(2))
    planes = [
        [event.cut.plane_W.to_vector() for event in events if hasattr(event, "cut")] for events in (first, second)
    ]
    assert np.array_equal(*planes)


@pytest.mark.parametrize("kind", ["grammar", "uniform", "shuffled"])
def test_plans_of_a_grammar_have_every_goal_fragment_once(kind):
    now, goal = (bar(0.16), bar(0.1, 0.5)), goal_of((*GOAL, 0.07, 0.03))
    pieces, targets = [Workpiece.of(fragment, 500) for fragment in now], targets_of(goal)
    source = GrammarPlans(FakeModel(), settings_of(), run_serially, kind)
    plans = source(now, goal, pieces, targets, 3, stream(0))
    assert 1 <= len(plans) <= 3
    for plan in plans:
        assert len(plan) == 2
        assert sorted(goal for tree in plan for goal in goals_of(tree)) == list(range(6))


def test_a_grammar_that_derives_nothing_is_replaced_by_halving():
    model = FakeModel(grammar=Grammar(3, {}, (0.3, 0.3, 0.4)))
    now, goal = (bar(0.16),), goal_of(GOAL)
    pieces, targets = [Workpiece.of(fragment, 500) for fragment in now], targets_of(goal)
    plans = GrammarPlans(model, settings_of(), run_serially, "grammar")(now, goal, pieces, targets, 2, stream(0))
    assert [sorted(goals_of(plan[0])) for plan in plans] == [[0, 1, 2, 3]] * 2


def test_changed_grammars_keep_the_number_of_productions():
    assert set(uniform(ENDS).probabilities) == set(ENDS.probabilities)
    assert len(shuffled(ENDS).probabilities) == len(ENDS.probabilities)
    assert (
        shuffled(ENDS, 1).probabilities != ENDS.probabilities or shuffled(ENDS, 2).probabilities != ENDS.probabilities
    )


def test_after_a_refusal_another_cut_is_asked_for():
    now, goal = (bar(0.16), bar(0.1, 0.5)), goal_of((*GOAL, 0.07, 0.03))
    planner, refused, asked = planner_of(), [], []
    for attempt in range(6):
        cut = planner.next_cut(now, goal, tuple(refused), stream(0, attempt))
        assert isinstance(cut, Cut)
        refused.append(Refusal(cut, "it is refused"))
        asked.append(np.concatenate([cut.plane_W.to_vector(), cut.p_WC[0]]))
    assert len(np.unique(np.round(asked, 6), axis=0)) == 6


def test_a_goal_of_as_many_fragments_needs_no_cut():
    now = (bar(0.16),)
    assert isinstance(planner_of().next_cut(now, now, (), stream(0)), Stuck)


def test_clouds_are_planned_for_as_their_hulls():
    clouds = tuple(Fragment(sample_surface(f.mesh, 800), f.X_WF) for f in (bar(0.16), *goal_of(GOAL)))
    cut = planner_of(structures="halve").next_cut(clouds[:1], clouds[1:], (), stream(0))
    assert isinstance(cut, Cut)
    assert abs(cut.plane_W.normal[2]) > 0.95


def test_the_explanation_keeps_how_the_prediction_rose():
    cut = planner_of().next_cut((bar(0.16),), goal_of(GOAL), (), stream(0))
    why = cut.explanation
    assert list(why.history) == sorted(why.history)
    assert why.predicted_iou == why.history[-1]
    assert sorted(node.goal for node in why.tree if node.goal is not None) == [0, 1, 2, 3]
    assert why.rollouts == int(0.85 * 1500 * 4)
    assert dataclasses.asdict(why)["production"].count("|") == 1
