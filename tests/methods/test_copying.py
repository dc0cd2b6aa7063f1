"""The control that copies the goal's planes of contact."""

from functools import lru_cache

import numpy as np
import pytest

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.copying import COPY, CopyPlanner
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings, TrialSettings
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.run_trial import run_trial
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.bench import Bench

SETTINGS = Settings()
FOODS = {name: getattr(foods, name) for name in foods.PROPORTIONS}


@lru_cache
def demonstration(trial=0, setup="N1M1", categories=("cubes",)):
    return make_demonstration(trial, SETUPS[setup], categories, FOODS, 0, SETTINGS.demonstrator)


def play(of, goal):
    bench = Bench(SETTINGS.world.min_share)
    planner = CopyPlanner()
    return run_trial(of.start, goal, planner, bench, [], lambda *names: stream(1, *names), TrialSettings())


@pytest.mark.parametrize(
    ("setup", "categories"),
    [
        ("N1M1", ("cubes",)),
        ("N1M1", ("strips",)),
        pytest.param("N2M2", ("chunks", "slices"), marks=pytest.mark.slow),
        pytest.param("N3M4", ("chunks", "slices", "cubes", "strips"), marks=pytest.mark.slow),
    ],
)
def test_copying_a_goal_in_place_reaches_it(setup, categories):
    of = demonstration(3, setup, categories)
    events = play(of, goal_for(of, "in-place", stream(0, "goal")))
    assert events[-1].iou_strict > 0.9


def test_the_cut_does_not_depend_on_the_goal_s_order_or_meshes(rng, remeshed):
    of = demonstration()
    goal = goal_for(of, "in-place", stream(0, "goal"))
    other = tuple(
        Fragment(remeshed(f.mesh, Pose.identity()), f.X_WF) for f in (goal[i] for i in rng.permutation(len(goal)))
    )
    cuts = [CopyPlanner().next_cut(of.start, same_goal, [], stream(0)) for same_goal in (goal, other)]
    assert cuts[0].plane_W.to_vector() == pytest.approx(cuts[1].plane_W.to_vector(), abs=1e-6)
    assert cuts[0].p_WC == pytest.approx(cuts[1].p_WC)


def test_the_cut_moves_with_the_fragments_and_the_goal(random_pose):
    of, X = demonstration(), random_pose()
    goal = goal_for(of, "in-place", stream(0, "goal"))
    moved = [tuple(Fragment(f.shape, X @ f.X_WF) for f in configuration) for configuration in (of.start, goal)]
    expected = CopyPlanner().next_cut(of.start, goal, [], stream(0)).plane_W.transformed(X).to_vector()
    moved_cut = CopyPlanner().next_cut(*moved, [], stream(0)).plane_W.to_vector()
    assert min(np.abs(moved_cut - sign * expected).max() for sign in (1, -1)) < 1e-7


def test_after_a_refusal_the_next_best_plane_is_tried_until_none_is_left():
    of = demonstration()
    goal = goal_for(of, "in-place", stream(0, "goal"))
    planner, refused, offsets = CopyPlanner(), [], []
    while isinstance(cut := planner.next_cut(of.start, goal, refused, stream(0)), Cut):
        offsets.append(tuple(cut.plane_W.to_vector()))
        refused.append(Refusal(cut, "no"))
    assert len(set(offsets)) == len(offsets) > 1
    assert cut == Stuck(f"all {len(offsets)} planes of contact that divide a current fragment were refused")


def test_the_planner_is_stuck_with_a_reason_if_nothing_can_be_copied():
    of = demonstration()
    goal = goal_for(of, "in-place", stream(0, "goal"))
    planner = CopyPlanner()
    scattered = goal_for(of, "scattered", stream(0, "goal"))
    assert planner.next_cut(of.start, scattered, [], stream(0)) == Stuck(
        "no two fragments of the goal touch on a plane"
    )
    clouds = tuple(Fragment(sample_surface(f.mesh, 64), f.X_WF) for f in goal)
    assert "point clouds have no faces" in planner.next_cut(of.start, clouds, [], stream(0)).reason
    assert "divides a current fragment" in planner.next_cut(of.goal, goal, [], stream(0)).reason


def test_copy_declares_that_it_applies_to_goals_in_place_only():
    assert COPY.applies_to("in-place")
    assert not COPY.applies_to("scattered")
    assert not COPY.sees_demonstration
