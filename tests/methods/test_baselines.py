"""The learned baselines: synthetic trials whose rule can be learned, and planners with simple known networks."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.interfaces import Refusal, Stuck
from cutgrammar.learning.fragment_choice_training import (
    BC,
    QNET,
    Batch,
    fit_choice,
    value_loss,
)
from cutgrammar.learning.steps import steps_of
from cutgrammar.methods.fragment_choice import BC as BC_METHOD
from cutgrammar.methods.fragment_choice import QNET as QNET_METHOD
from cutgrammar.methods.method import PlanningContext
from cutgrammar.settings import BaselineSettings, Settings

QUICK = BaselineSettings(embedding_size=4, hidden_size=16, epochs=80, learning_rate=1e-2, jitter=0.1, n_folds=2)
SIZE, KIND = 0, 1
"""Features that matter in made-up trials: how large a fragment is, and which of two kinds of food."""


def made_up(rng, trials=16, cuts=4):
    """Trials in which the largest fragment is halved each time; each begins with one fragment of either kind.

    The goal tells which kind is cut: only that kind has become small in it.
    """
    z, of_trial, made = [], [], []

    def appear(trial, size, kind):
        feature = np.zeros(17)
        feature[[SIZE, KIND]] = np.array([np.log2(size), kind]) + rng.normal(scale=0.05, size=2)
        z.append(np.tile(feature, (4, 1)))
        of_trial.append(trial)
        return len(z) - 1

    for trial in range(trials):
        alive = {kind: [(1.0, appear(trial, 1.0, kind))] for kind in (-1.0, 1.0)}
        kind = (-1.0, 1.0)[trial % 2]
        for _ in range(cuts):
            size, cut = max(alive[kind])
            alive[kind].remove((size, cut))
            products = tuple(appear(trial, size * share, kind) for share in (0.55, 0.45))
            alive[kind] += zip((size * 0.55, size * 0.45), products, strict=True)
            made.append((cut, products, SimpleNamespace(plane_C=Plane(np.array([0.0, 0.0, 1.0]), 0.0))))
    return steps_of(np.array(z), of_trial, made)


@pytest.fixture(scope="module")
def steps():
    return made_up(np.random.default_rng(5))


@pytest.mark.parametrize("method", [BC, QNET])
def test_the_choice_of_the_fragment_is_learned_and_holds_on_held_out_trials(steps, method):
    found = fit_choice(steps, method, QUICK, 0)[1]
    assert len(found.losses) == QUICK.epochs
    assert found.accuracy > found.chance + 0.3
    assert found.loss < found.losses[0]


@pytest.mark.parametrize("method", [BC, QNET])
def test_one_seed_trains_the_same_bits_and_another_does_not(steps, method):
    quick = replace(QUICK, epochs=5)
    bits = [fit_choice(steps, method, quick, seed)[0].to_bytes() for seed in (0, 0, 1)]
    assert bits[0] == bits[1] != bits[2]


def test_one_trial_alone_is_fitted_without_holding_out(steps):
    alone = steps.of(np.arange(4))
    assert fit_choice(alone, BC, QUICK, 0)[1].losses == ()
    assert fit_choice(alone, BC, replace(QUICK, epochs=3), 0)[0].sets == 2


def test_the_value_of_a_step_is_the_discounted_reward_of_reaching_the_goal(steps):
    network = fit_choice(steps, QNET, replace(QUICK, epochs=200), 0)[0]
    worth = [
        network(steps.z[[steps.cut[i]], 0], steps.z[steps.now[i], 0], steps.z[steps.goal[i], 0])[0, 0]
        for i in range(len(steps))
    ]
    by_step = np.array(worth).reshape(-1, 4).mean(axis=0)
    assert by_step == pytest.approx(QUICK.discount ** np.arange(3, -1, -1), abs=0.15)
    assert by_step[0] < by_step[1:].min()


def test_the_value_loss_is_the_squared_difference_from_the_target_and_the_margin(steps):
    batch = SimpleNamespace(cut=torch.tensor([0, 1]))
    values = torch.tensor([[0.5, 0.4], [-torch.inf, 0.7]])
    settings = BaselineSettings(margin=0.3, margin_weight=2.0)
    losses = value_loss(settings)(batch, values, torch.tensor([0.4, 1.0]))
    assert losses.tolist() == pytest.approx([0.1**2 + 2.0 * (0.4 + 0.3 - 0.5), 0.3**2])


def test_the_target_is_the_discounted_best_value_of_the_next_step_and_the_return_the_discounted_reward(steps):
    batch = Batch.of(steps.of(np.arange(8)))
    assert batch.returns(0.5).tolist() == [0.125, 0.25, 0.5, 1.0] * 2
    values = torch.where(batch.now.present, torch.arange(8.0)[:, None], -torch.inf)
    following = values[batch.after.clamp(min=0)]
    assert batch.bootstrapped_targets(following, 0.5).tolist() == [0.5, 1.0, 1.5, 1.0, 2.5, 3.0, 3.5, 1.0]


def test_a_batch_keeps_the_place_of_the_fragment_that_was_cut_among_the_current_ones(steps):
    batch = Batch.of(steps)
    rows = torch.arange(len(steps))
    assert batch.now.members[rows, batch.cut].tolist() == steps.cut.tolist()
    assert batch.now.present.sum(dim=1).tolist() == [len(now) for now in steps.now]
    some = batch.at(torch.tensor([5, 2]))
    assert (some.cut.tolist(), some.after.tolist()) == (batch.cut[[5, 2]].tolist(), batch.after[[5, 2]].tolist())


@pytest.mark.parametrize("method", [BC, QNET])
def test_batches_of_steps_learn_what_all_steps_teach(steps, method):
    found = fit_choice(steps, method, replace(QUICK, batch_size=16, epochs=160), 0)[1]
    assert found.accuracy > found.chance + 0.3


# --- planners ---------------------------------------------------------------------------------------------------------


class ByLength:
    """Scores a fragment by its length in centimetres; keeps the goal it was given."""

    def __call__(self, z, now, goal):
        assert z is now
        self.goal = goal
        return z[:, :1]


class InTheMiddle:
    def sample(self, z, z_goal, rng, draws=1):
        return Plane(np.array([0.0, 0.0, 1.0]), rng.normal(0.0, 1e-4))


@pytest.fixture
def model():
    def features(shape):
        model.asked += 1
        return np.full(17, 100.0 * np.ptp(shape.points if hasattr(shape, "points") else shape.vertices, axis=0).max())

    model = SimpleNamespace(features=features, policy=ByLength(), values=ByLength(), goal_planes=InTheMiddle(), asked=0)
    return model


def bar(length, at=0.0):
    box = trimesh.creation.box([length, 0.010, 0.012])
    return Fragment(Mesh(box.vertices, box.faces), Pose(np.eye(3), np.array([at, 0.0, 0.0])))


NOW = (bar(0.02), bar(0.03, 0.1), bar(0.02, 0.2))
GOAL = tuple(bar(0.01, 0.05 * i) for i in range(6))


def cuts_of(method, model, count, refused=()):
    planner = method.planner(PlanningContext(model, Settings()))
    return [planner.next_cut(NOW, GOAL, refused, np.random.default_rng(i)) for i in range(count)]


def test_bc_draws_the_fragment_by_the_softmax_of_the_scores(model):
    counts = Counter(round(float(cut.p_WC[0, 0]), 1) for cut in cuts_of(BC_METHOD, model, 600))
    expected = np.exp([2.0, 3.0, 2.0]) / np.exp([2.0, 3.0, 2.0]).sum()
    assert [counts[at] / 600 for at in (0.0, 0.1, 0.2)] == pytest.approx(expected, abs=0.06)


def test_qnet_cuts_the_best_fragment_and_draws_the_plane(model):
    cuts = cuts_of(QNET_METHOD, model, 5)
    assert all(np.allclose(cut.p_WC, NOW[1].p_WC) for cut in cuts)
    assert len({cut.plane_W.offset for cut in cuts}) == 5


@pytest.mark.parametrize("method", [BC_METHOD, QNET_METHOD])
def test_planes_divide_the_chosen_fragment_wherever_it_is(model, method):
    for cut in cuts_of(method, model, 5):
        assert abs(cut.plane_W.distances(cut.p_WC)[0]) < 1e-3
        assert abs(cut.plane_W.normal[0]) == pytest.approx(1.0)  # across the longest axis


@pytest.mark.parametrize("method", [BC_METHOD, QNET_METHOD])
def test_the_same_stream_gives_the_same_cut_and_the_feature_of_each_shape_is_computed_once(model, method):
    planner = method.planner(PlanningContext(model, Settings()))
    one = planner.next_cut(NOW, GOAL, (), np.random.default_rng(3))
    asked = model.asked
    other = planner.next_cut(NOW, GOAL, (Refusal(one, "grazes"),), np.random.default_rng(3))
    assert (one.plane_W.to_vector() == other.plane_W.to_vector()).all()
    assert model.asked == asked == len(NOW) + len(GOAL)


@pytest.mark.parametrize("method", [BC_METHOD, QNET_METHOD])
def test_clouds_serve_as_goal_and_enough_fragments_end_the_plan(model, method):
    planner = method.planner(PlanningContext(model, Settings()))
    clouds = tuple(Fragment(sample_surface(fragment.mesh, 64), fragment.X_WF) for fragment in GOAL)
    assert planner.next_cut(NOW, clouds, (), np.random.default_rng(0)).p_WC.shape == (1, 3)
    assert planner.next_cut(GOAL, GOAL, (), np.random.default_rng(0)) == Stuck(
        "there are 6 fragments already and the goal has 6"
    )
