from functools import partial

import numpy as np
import pytest

from cutgrammar.events import CutFailed, CutMade, CutRefused, GaveUp, Planned, Scored
from cutgrammar.geometry.fragment import Cloud, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Sighted, Stuck
from cutgrammar.seeds import stream
from cutgrammar.settings import TrialSettings
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.scoring import score

STREAM = partial(stream, 0, "test")


class Halver:
    """Plans a cut of the largest fragment across x through its centroid, and keeps what it was given."""

    def __init__(self, stuck_after=None):
        self.seen, self.stuck_after = [], stuck_after

    def next_cut(self, now, goal, refused, rng):
        self.seen.append((len(now), [refusal.reason for refusal in refused], rng.integers(1 << 30)))
        if len(self.seen) == self.stuck_after:
            return Stuck("no idea")
        largest = max(now, key=lambda f: f.mesh.volume)
        return Cut(Plane.through(largest.p_WC, [1.0, 0.0, 0.0]), largest.p_WC[None])


class Table:
    """Cuts in place; `answers` are given instead of cutting while there are some."""

    def __init__(self, answers=()):
        self.answers, self.now = list(answers), ()

    def reset(self, start, foods=()):
        self.now, self.foods = start, foods

    def observe(self):
        return self.now

    truth = observe

    def apply(self, cut):
        answer = self.answers.pop(0) if self.answers else None
        if answer is not None:
            return answer
        [chosen] = [f for f in self.now if np.allclose(f.p_WC, cut.p_WC[0])]
        products = slice_mesh(chosen.mesh, cut.plane_W.transformed(chosen.X_WF.inverse())).products
        self.now = tuple(f for f in self.now if f is not chosen) + tuple(Fragment(p, chosen.X_WF) for p in products)
        return Done(len(products))


@pytest.fixture
def start(lump):
    return (Fragment(lump, Pose.identity()),)


@pytest.fixture
def goal(start):
    table, planner = Table(), Halver()
    table.reset(start)
    for _ in range(3):
        table.apply(planner.next_cut(table.now, (), (), np.random.default_rng(0)))
    return table.now


def kinds(events):
    return [type(event).__name__ for event in events]


class WatchedTable(Table):
    """Is seen by a camera with one point a fragment."""

    def sighted(self, step):
        points = np.array([f.p_WC for f in self.now])
        return Sighted(step, points, np.arange(len(points)), np.arange(len(points)), self.now)


def play(start, goal, planner=None, world=None, observers=(), max_refusals=10, **more):
    return run_trial(
        start, goal, planner or Halver(), world or Table(), observers, STREAM, TrialSettings(max_refusals), **more
    )


def test_a_trial_ends_when_the_goals_number_of_fragments_is_reached_and_is_scored(start, goal):
    events = play(start, goal)
    assert kinds(events) == ["Planned", "CutMade"] * 3 + ["Scored"]
    assert [event.step for event in events if isinstance(event, Planned)] == [1, 2, 3]
    assert events[-1].scores["iou"] == pytest.approx(1.0)
    assert events[-1].iou_strict == pytest.approx(1.0)
    assert sorted(j for _, j, _ in events[-1].pairs) == [0, 1, 2, 3]


def test_nothing_is_cut_where_the_start_has_enough_fragments(start):
    planner = Halver()
    assert kinds(play(start, start, planner)) == ["Scored"]
    assert planner.seen == []


def test_the_planner_is_given_the_refusals_of_a_step_and_a_new_stream_for_each_attempt(start, goal):
    planner = Halver()
    events = play(start, goal, planner, Table([Refused("a"), Refused("b")]))
    assert kinds(events)[:6] == ["Planned", "CutRefused", "Planned", "CutRefused", "Planned", "CutMade"]
    assert [reasons for _, reasons, _ in planner.seen] == [[], ["a"], ["a", "b"], [], []]
    assert [number for _, _, number in planner.seen] == [
        STREAM(step, attempt).integers(1 << 30) for step, attempt in [(1, 0), (1, 1), (1, 2), (2, 0), (3, 0)]
    ]


def test_too_many_refusals_in_a_step_end_the_trial_as_stuck_and_it_is_scored(start, goal):
    events = play(start, goal, world=Table([None] + [Refused("too hard")] * 9), max_refusals=3)
    assert kinds(events) == ["Planned", "CutMade"] + ["Planned", "CutRefused"] * 3 + ["GaveUp", "Scored"]
    assert events[-2] == GaveUp(2, "3 cuts were refused in this step, the last because too hard")
    assert events[-1].fragments == 2
    assert events[-1].iou_strict == pytest.approx(events[-1].scores["iou"] / 2)


def test_a_planner_that_is_stuck_and_a_world_that_fails_end_the_trial_with_a_score(start, goal):
    assert play(start, goal, Halver(stuck_after=2))[-2] == GaveUp(2, "no idea")
    events = play(start, goal, world=Table([None, Failed("the knife broke")]))
    assert events[-2] == CutFailed(2, "the knife broke")
    assert isinstance(events[-1], Scored)


def test_observers_are_called_with_the_events_that_are_returned_in_order(start, goal):
    told, also = [], []
    events = play(start, goal, world=Table([Refused("a")]), observers=[told.append, also.append])
    assert told == also == events


def test_events_hold_the_true_configuration(start, goal):
    made = [event for event in play(start, goal) if isinstance(event, CutMade)]
    assert [len(event.configuration) for event in made] == [2, 3, 4]
    assert [event.products for event in made] == [2, 2, 2]
    volumes = [sum(f.mesh.volume for f in event.configuration) for event in made]
    assert volumes == pytest.approx([start[0].mesh.volume] * 3)


def test_a_world_with_cameras_reports_what_they_saw_before_every_plan(start, goal):
    events = play(start, goal, world=WatchedTable([Refused("a")]))
    assert kinds(events)[:4] == ["Sighted", "Planned", "CutRefused", "Sighted"]
    assert [event.step for event in events if isinstance(event, Sighted)] == [1, 1, 2, 3]


def test_the_world_gets_the_foods_the_planner_the_goal_as_seen_and_the_score_the_true_goal(start, goal):
    given, table = [], Table()

    class Watcher(Halver):
        def next_cut(self, now, goal, refused, rng):
            given.append(goal)
            return super().next_cut(now, goal, refused, rng)

    scanned = tuple(Fragment(cloud_of(f.mesh, 64), f.X_WF) for f in goal)
    events = play(start, goal, Watcher(), table, foods=("carrot",), goal_seen=scanned)
    assert table.foods == ("carrot",)
    assert all(goal is scanned for goal in given)
    assert events[-1].scores["iou"] == pytest.approx(1.0)


def test_point_clouds_have_no_score_and_the_event_gives_the_reason(start, goal):
    seen = tuple(Fragment(cloud_of(f.mesh, 64), f.X_WF) for f in goal)
    assert isinstance(seen[0].shape, Cloud)
    scored = score(start, seen)
    assert scored.scores["iou"] is None
    assert scored.iou_strict == 0.0
    assert (scored.fragments, scored.goal_fragments) == (1, 4)
    assert "point clouds" in scored.reason


def test_refusals_carry_their_attempt(start, goal):
    events = play(start, goal, world=Table([Refused("a"), Refused("b")]))
    assert [(e.step, e.attempt) for e in events if isinstance(e, CutRefused)] == [(1, 0), (1, 1)]
