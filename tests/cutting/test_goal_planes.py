from types import SimpleNamespace

import numpy as np
import pytest

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.geometry.plane import Plane
from cutgrammar.learning.goal_plane_training import fit_goal_planes, targets_of
from cutgrammar.learning.steps import steps_of
from cutgrammar.perception.feature import z_scale
from cutgrammar.settings import BaselineSettings, PlaneSettings

QUICK = BaselineSettings(
    embedding_size=4, hidden_size=32, plane_epochs=300, plane_jitter=1.0, learning_rate=5e-3, n_folds=2
)
MIXTURE = PlaneSettings(n_components=8)
FLAT, LONG = -1.0, 1.0
"""What the goal's fragments are like: flat ones are cut off across z, long ones across x."""


def feature(rng, kind, scale):
    z = np.append(rng.normal(scale=0.2, size=16), z_scale(scale))
    z[0] = kind
    return np.tile(z, (4, 1))


@pytest.fixture(scope="module")
def steps():
    rng = np.random.default_rng(2)
    z, trials, cuts = [], [], []
    for trial in range(30):
        kind, scale = (FLAT, LONG)[trial % 2], rng.uniform(0.02, 0.1)
        z += [feature(rng, 0.0, scale), *(feature(rng, kind, 0.6 * scale) for _ in range(2))]
        trials += [trial] * 3
        normal = np.array([0, 0, 1.0] if kind == FLAT else [1.0, 0, 0]) + rng.normal(scale=0.02, size=3)
        plane = Plane(normal / np.linalg.norm(normal), scale * rng.normal(0.3, 0.02) * rng.choice([-1, 1]))
        cuts.append((3 * trial, (3 * trial + 1, 3 * trial + 2), SimpleNamespace(plane_C=plane)))
    return steps_of(np.array(z), trials, cuts)


@pytest.fixture(scope="module")
def network(steps):
    return fit_goal_planes(steps, QUICK, MIXTURE, 0)[0]


@pytest.mark.parametrize(("kind", "axis"), [(FLAT, 2), (LONG, 0)])
def test_the_same_fragment_is_cut_differently_for_different_goals(network, kind, axis):
    rng = np.random.default_rng(7)
    z, goal = feature(rng, 0.0, 0.05)[0], np.array([feature(rng, kind, 0.03)[0] for _ in range(2)])
    planes = np.array([np.abs(network.sample(z, goal, rng).to_vector()) for _ in range(300)])
    assert np.median(planes[:, axis]) > 0.97
    assert np.median(planes[:, 3]) == pytest.approx(0.05 * 0.3, rel=0.25)
    assert np.linalg.norm(planes[:, :3], axis=1) == pytest.approx(1.0)


def test_the_network_beats_one_gaussian_on_held_out_trials(steps):
    found = fit_goal_planes(steps, QUICK, MIXTURE, 0)[1]
    assert len(found.losses) == QUICK.plane_epochs
    assert found.loss < found.gaussian_loss - 1.0


def test_targets_are_the_plane_under_every_flip(steps):
    targets = targets_of(steps)
    assert targets.shape == (4, len(steps), 4)
    assert np.abs(targets[1]) == pytest.approx(np.abs(targets[0]))
    assert targets[0, 0] == pytest.approx(np.append(steps.planes_C[0].normal, targets[0, 0, 3]))


def test_one_seed_trains_the_same_bits_and_another_does_not(steps):
    quick = BaselineSettings(embedding_size=4, hidden_size=8, plane_epochs=4, n_folds=2)
    bits = [fit_goal_planes(steps, quick, MIXTURE, seed)[0].to_bytes() for seed in (0, 0, 1)]
    assert bits[0] == bits[1] != bits[2]


def test_a_network_can_be_read_from_its_bytes_and_other_bytes_are_refused(network):
    again = GoalPlaneNetwork.from_bytes(network.to_bytes())
    assert again.to_bytes() == network.to_bytes()
    with pytest.raises(ValueError, match="not a network for cutting planes given the goal"):
        GoalPlaneNetwork.from_bytes(network.network.to_bytes())
    with pytest.raises(ValueError, match="does not make a mixture of 5"):
        GoalPlaneNetwork(5, 0.02, network.network)
