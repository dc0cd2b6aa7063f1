import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from cutgrammar.events import CutMade, CutRefused, GaveUp, Scored
from cutgrammar.geometry.canonical import FLIPS, canonical_frame
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods import alignment
from cutgrammar.methods.alignment import aligned_canonical_frame
from cutgrammar.methods.controls import REPLAY, RETRY_SHIFT, LargestPlanner, RandomPlanner
from cutgrammar.methods.locating import Locator
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.registry import find_method
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings, TrialSettings
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.bench import Bench
from cutgrammar_sim.worlds.board import Board
from simple_shapes import box_fragment

SETTINGS = Settings()
FOODS = {name: getattr(foods, name) for name in foods.PROPORTIONS}
CONTROLS = ("random", "largest", "halve", "peel", "replay")


@lru_cache
def demonstration(trial=0, setup="N2M1", categories=("strips",)):
    return make_demonstration(trial, SETUPS[setup], categories, FOODS, 0, SETTINGS.demonstrator)


def planner_called(name, of=None):
    return find_method(name).planner(PlanningContext(None, SETTINGS, of or demonstration()))


def play(planner, world, of):
    return run_trial(of.start, of.goal, planner, world, [], lambda *names: stream(11, *names), TrialSettings())


def bench():
    return Bench(SETTINGS.world.min_share)


def as_cloud(fragment):
    return Fragment(sample_surface(fragment.mesh, 512), fragment.X_WF)


def test_only_replay_sees_the_demonstration():
    assert [name for name in CONTROLS if find_method(name).sees_demonstration] == ["replay"]
    with pytest.raises(ValueError, match="sees_demonstration"):
        REPLAY.planner(PlanningContext(None, SETTINGS))


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("perceive", [lambda f: f, as_cloud], ids=["meshes", "clouds"])
def test_a_control_names_one_current_fragment_and_crosses_it(name, perceive):
    now = tuple(perceive(fragment) for fragment in demonstration().start)
    planner = planner_called(name)
    for attempt in range(5):
        cut = planner.next_cut(now, demonstration().goal, [], stream(0, attempt))
        assert isinstance(cut, Cut)
        (chosen,) = [f for f in now if np.array_equal(f.p_WC, cut.p_WC[0])]
        points = chosen.mesh.vertices if perceive is not as_cloud else chosen.shape.points
        distances = cut.plane_W.distances(chosen.X_WF.apply(points))
        assert distances.min() < 0 < distances.max()


@pytest.mark.parametrize("name", CONTROLS)
def test_a_control_repeats_itself_given_the_same_stream(name):
    of = demonstration()
    cuts = [planner_called(name).next_cut(of.start, of.goal, [], stream(4)) for _ in range(2)]
    assert np.array_equal(*[cut.plane_W.to_vector() for cut in cuts])
    assert np.array_equal(*[cut.p_WC for cut in cuts])


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("kind", ["bench", "board"])
def test_a_control_plays_a_trial_to_its_end(name, kind):
    of = demonstration(1, "N1M1", ("chunks",))
    events = play(planner_called(name, of), bench() if kind == "bench" else Board(SETTINGS.world), of)
    assert isinstance(events[-1], Scored)
    assert events[-1].fragments >= events[-1].goal_fragments
    assert 0.0 <= events[-1].iou_strict <= 1.0 + 1e-9


def test_random_cuts_every_fragment_and_keeps_away_from_its_ends():
    now = demonstration().configuration(4)
    taken = []
    for seed in range(100):
        cut = RandomPlanner().next_cut(now, (), [], stream(seed))
        taken.append(next(i for i, f in enumerate(now) if np.array_equal(f.p_WC, cut.p_WC[0])))
        heights = now[taken[-1]].X_WF.apply(now[taken[-1]].mesh.vertices) @ cut.plane_W.normal
        share = (-cut.plane_W.offset - heights.min()) / np.ptp(heights)
        assert 0.1 <= share <= 0.9
    assert set(taken) == set(range(len(now)))


@pytest.mark.parametrize("perceive", [lambda f: f, as_cloud], ids=["meshes", "clouds"])
def test_largest_cuts_the_largest(perceive):
    of = demonstration(3, "N2M1", ("slices",))
    now = of.configuration(5)
    largest = max(range(len(now)), key=lambda i: now[i].mesh.volume)
    cut = LargestPlanner().next_cut(tuple(perceive(f) for f in now), of.goal, [], stream(0))
    assert cut.p_WC[0] == pytest.approx(now[largest].p_WC, abs=3e-3)


def test_largest_cuts_across_the_long_axis_at_every_position_in_the_middle():
    now = (box_fragment([0.03, 0.16, 0.02], [0.1, 0.0, 0.0], heading=0.4), box_fragment([0.2, 0.01, 0.01], [0, 1, 0]))
    across = now[0].X_WF.rotation[:, 1]
    heights = []
    for seed in range(200):
        plane = LargestPlanner().next_cut(now, (), [], stream(seed)).plane_W
        assert abs(plane.normal @ across) == pytest.approx(1.0)
        heights.append(-float(plane.distances(now[0].p_WC)) * float(plane.normal @ across) / 0.16 + 0.5)
    assert 0.1 <= min(heights) < 0.13
    assert 0.87 < max(heights) <= 0.9
    assert np.mean(heights) == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize(
    ("setup", "categories"),
    [
        ("N1M2", ("slices", "strips")),
        pytest.param("N2M2", ("chunks", "slices"), marks=pytest.mark.slow),
        pytest.param("N3M4", ("chunks", "slices", "cubes", "strips"), marks=pytest.mark.slow),
    ],
)
def test_replay_reproduces_the_demonstration_on_the_bench(setup, categories):
    of = demonstration(2, setup, categories)
    events = play(planner_called("replay", of), bench(), of)
    assert events[-1].iou_strict > 1 - 1e-6
    assert not any(isinstance(event, CutRefused) for event in events)
    made = [event for event in events if isinstance(event, CutMade)]
    assert len(made) == sum(not cut.undone for cut in of.cuts)
    for event, cut in zip(made, of.cuts, strict=True):
        volumes = [f.mesh.volume for f in event.configuration]
        demonstrated = [f.mesh.volume for f in of.configuration(cut.step)]
        assert sorted(volumes) == pytest.approx(sorted(demonstrated), rel=1e-9)


def test_replay_reproduces_the_shapes_on_the_board_where_all_fragments_have_moved():
    of = demonstration(4, "N2M1", ("chunks",))
    events = play(planner_called("replay", of), Board(SETTINGS.world), of)
    assert events[-1].iou_strict > 1 - 1e-6


def test_the_current_fragments_show_how_far_a_demonstration_has_been_carried_out(random_pose, rng):
    of = demonstration(5, "N1M1", ("cubes",))
    locator = Locator(of)
    for step in (0, 1, of.steps // 2, of.steps):
        order = rng.permutation(len(of.alive(step)))
        now = tuple(of.configuration(step)[i] for i in order)
        scattered = tuple(Fragment(f.shape, random_pose()) for f in now)
        for current in (now, scattered):
            made, found = locator.locate(current)
            assert made == step
            assert [found[of.alive(step)[i]] for i in order] == list(range(len(now)))


def test_replay_moves_the_plane_with_the_fragment(random_pose):
    of = demonstration()
    X = random_pose()
    moved = tuple(Fragment(f.shape, X @ f.X_WF) for f in of.start)
    cut = planner_called("replay").next_cut(moved, of.goal, [], stream(0))
    assert cut.plane_W.to_vector() == pytest.approx(of.cuts[0].plane_W.transformed(X).to_vector(), abs=1e-9)


def test_replay_shifts_a_plane_that_was_refused_and_only_then():
    of = demonstration()
    first = planner_called("replay").next_cut(of.start, of.goal, [], stream(0))
    again = planner_called("replay").next_cut(of.start, of.goal, [Refusal(first, "why not")], stream(1))
    assert first.plane_W.to_vector() == pytest.approx(of.cuts[0].plane_W.to_vector(), abs=1e-12)
    assert np.array_equal(again.plane_W.normal, first.plane_W.normal)
    assert 0 < abs(again.plane_W.offset - first.plane_W.offset) < 5 * RETRY_SHIFT


def test_replay_leaves_out_undone_cuts():
    of = demonstration()
    mistake = dataclasses.replace(of.cuts[0], plane_C=of.cuts[1].plane_C, undone=True)
    with_mistake = dataclasses.replace(of, cuts=(mistake, *of.cuts))
    cut = planner_called("replay", with_mistake).next_cut(of.start, of.goal, [], stream(0))
    assert cut.plane_W.to_vector() == pytest.approx(of.cuts[0].plane_W.to_vector(), abs=1e-12)


def test_replay_is_stuck_after_the_last_cut():
    of = demonstration()
    said = planner_called("replay").next_cut(of.goal, of.goal, [], stream(0))
    assert said == Stuck("the demonstration has no further cut")


def test_ten_refusals_end_a_trial():
    of = demonstration()
    refuses_all = Bench(1.0)  # no product is as large as what was cut
    events = play(planner_called("replay"), refuses_all, of)
    assert sum(isinstance(event, CutRefused) for event in events) == 10
    assert isinstance(events[-2], GaveUp)


@pytest.mark.parametrize("flip", FLIPS)
def test_ambiguous_signs_of_a_frame_are_chosen_to_fit_the_demonstrated_fragment(flip, lump, random_pose, monkeypatch):
    X = random_pose()
    frames = iter([X @ canonical_frame(lump) @ flip, canonical_frame(lump)])  # as if the octant rule had been noise
    monkeypatch.setattr(alignment, "canonical_frame", lambda shape: next(frames))
    aligned = aligned_canonical_frame(lump.moved(X), lump)
    assert aligned.to_vector() == pytest.approx((X @ canonical_frame(lump)).to_vector())
