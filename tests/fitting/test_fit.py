"""Fitting plans: never worse than the start, deterministic, within its budget; kept scores equal those made anew."""

import numpy as np
import pytest
import trimesh

from cutgrammar.fitting.annealing import anneal
from cutgrammar.fitting.fit import fit
from cutgrammar.fitting.interior_points import interior_points
from cutgrammar.fitting.plan_fit import KINDS, MIX, NO_DRAWS, Budget, PlanFit, resolution
from cutgrammar.fitting.plan_state import UNSCORED, add_up_wanted, duplicate, total_iou
from cutgrammar.fitting.plan_tree import Branch, Leaf, goals_of
from cutgrammar.fitting.recut import recut
from cutgrammar.fitting.starting_plans import halved, shared_out
from cutgrammar.fitting.targets import targets_of
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.inference.draws import draws_from
from cutgrammar.settings import FittingLevel, FittingSettings
from cutgrammar_sim.foods import block, carrot

SETTINGS = FittingSettings(
    levels=(
        FittingLevel(40, 0, 0.3, 0.12, 0.8),
        FittingLevel(80, 80, 0.15, 0.04, 0.8),
        FittingLevel(200, 200, 0.3, 0.012, 0.3),
    )
)


def slices_of(mesh, shares):
    """Fragments of `mesh` cut across x at these shares of its length."""
    low, high = mesh.vertices[:, 0].min(), mesh.vertices[:, 0].max()
    rest, found = mesh, []
    for share in shares:
        sliced = slice_mesh(rest, Plane(np.array([1.0, 0.0, 0.0]), -(low + share * (high - low))))
        found.append(sliced.below[0])
        rest = sliced.above[0]
    return [Fragment(part, Pose.identity()) for part in (*found, rest)]


@pytest.fixture(scope="module")
def problem():
    """Two objects, their slices as the goal, and starting plans for both."""
    rng = np.random.default_rng(3)
    now = [Fragment(make(rng), Pose.identity()) for make in (carrot, block)]
    goal = slices_of(now[0].mesh, (0.15, 0.35, 0.6)) + slices_of(now[1].mesh, (0.3, 0.6))
    targets = targets_of(goal)
    pieces = [Workpiece.of(fragment, 600 * len(goal)) for fragment in now]
    volumes = np.array([piece.volume for piece in pieces])
    starts = [tuple(halved(goals) for goals in shared_out(volumes, targets.volumes, rng)) for _ in range(2)]
    return starts, pieces, targets


def fitted(problem, evaluations, seed=0, deadline=None):
    starts, pieces, targets = problem
    return fit(starts, pieces, targets, SETTINGS, Budget(evaluations, deadline), np.random.default_rng(seed))


def test_a_fitted_plan_is_never_worse_than_its_starts(problem):
    starts, pieces, targets = problem
    start = max(PlanFit.of(each, pieces, targets, resolution(targets, 200, 10**6), 200).iou for each in starts)
    for evaluations in (1, 10, 200):
        for seed in range(3):
            assert fitted(problem, evaluations, seed).iou >= start


def test_fitting_recovers_how_objects_were_cut(problem):
    assert fitted(problem, 20000).iou > 0.93


def test_the_same_stream_gives_the_same_plan_and_another_one_another(problem):
    first, second, third = (fitted(problem, 500, seed) for seed in (0, 0, 1))
    assert first.history == second.history
    assert np.array_equal(first.leaf_ious, second.leaf_ious)
    assert first.history != third.history


def test_the_budget_is_kept_and_the_history_rises(problem):
    history = fitted(problem, 5000).history
    counts, ious = zip(*history, strict=True)
    assert counts[-1] == 5000
    assert list(counts) == sorted(counts)
    assert list(ious) == sorted(ious)


def test_a_deadline_in_the_past_ends_the_fitting_at_once(problem):
    assert fitted(problem, 10**9, deadline=0.0).history[-1][0] == 0


def test_every_goal_fragment_stays_at_exactly_one_leaf(problem):
    plan = fitted(problem, 3000)
    assert sorted(goal for tree in plan.trees for goal in goals_of(tree)) == list(range(7))


def test_a_plan_evaluated_step_by_step_equals_one_evaluated_anew(problem):
    starts, pieces, targets = problem
    plan, draws = PlanFit.of(starts[0], pieces, targets, 700), draws_from(np.random.default_rng(5))
    counts = np.zeros((KINDS, 2), np.int64)
    for _ in range(200):
        anneal(plan.state, plan.backup, plan.best, targets, plan.scratch, draws, 20, 0.3, 0.3, 0.8, MIX, counts)
        anew = duplicate(plan.state)
        anew.key[:] = UNSCORED
        add_up_wanted(anew, targets.volumes)
        for root in range(len(pieces)):
            plan.scratch.tops[0] = root
            recut(anew, targets, plan.scratch, 1, -1.0, NO_DRAWS)
        assert np.array_equal(anew.wanted, plan.state.wanted)
        # The points are in another order, and occupancies are added up in single precision.
        assert total_iou(anew) == pytest.approx(total_iou(plan.state), abs=1e-5)
    assert (counts[:, 1] > 0).all(), "a kind of move was never kept"


def test_a_plan_of_one_leaf_for_each_fragment_needs_no_cut(problem):
    _, pieces, _ = problem
    targets = targets_of([Fragment(piece.solid, Pose.identity()) for piece in pieces])
    plan = PlanFit.of([Leaf(0), Leaf(1)], pieces, targets, 1000)
    assert plan.iou > 0.95
    assert isinstance(halved([0, 1]), Branch)


def test_points_lie_inside_a_solid_of_two_balls_and_nowhere_between():
    ball = trimesh.creation.icosphere(4)
    both = trimesh.util.concatenate([ball.copy().apply_translation([x, 0.0, 0.0]) for x in (-1.5, 1.5)])
    points = interior_points(Mesh(both.vertices, both.faces), 4000, Pose.identity())
    distances = np.linalg.norm(np.abs(points) - [1.5, 0.0, 0.0], axis=1)
    assert len(points) == 4000
    assert distances.max() < 1.0
    assert np.mean(distances < 0.5) == pytest.approx(0.125, abs=0.01)
