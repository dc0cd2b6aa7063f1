import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from cutgrammar.learning.plane_training import log_densities
from cutgrammar.nn.mixture import Mixture, mixture_of, numbers_of


@pytest.fixture
def raw(rng):
    return rng.normal(size=(6, numbers_of(3, 4)))


def test_the_density_is_that_of_its_gaussians(rng):
    weights, means, sigmas = np.array([0.2, 0.8]), rng.normal(size=(2, 4)), rng.uniform(0.1, 1, size=(2, 4))
    points = rng.normal(size=(20, 4))
    parts = [
        w * multivariate_normal(m, np.diag(s**2)).pdf(points) for w, m, s in zip(weights, means, sigmas, strict=True)
    ]
    assert Mixture(weights, means, sigmas).log_density(points) == pytest.approx(np.log(sum(parts)))


def test_training_and_inference_use_the_same_mixture(raw, rng):
    points = rng.normal(size=(6, 4))
    trained = log_densities(torch.tensor(raw), torch.tensor(points), 3, 0.05).numpy()
    inferred = [mixture_of(row, 3, 0.05).log_density(point[None])[0] for row, point in zip(raw, points, strict=True)]
    assert trained == pytest.approx(np.array(inferred))


def test_no_sigma_falls_below_the_floor(raw):
    for row in 100 * raw:
        mixture = mixture_of(row, 3, 0.05)
        assert mixture.sigmas.min() >= 0.05
        assert mixture.weights.sum() == pytest.approx(1.0)


def test_draws_have_the_moments_of_the_mixture(rng):
    mixture = Mixture(np.array([0.3, 0.7]), np.array([[-2.0, 0.0], [1.0, 1.0]]), np.full((2, 2), 0.1))
    draws = np.array([mixture.sample(rng) for _ in range(4000)])
    assert draws.mean(axis=0) == pytest.approx(mixture.weights @ mixture.means, abs=0.1)
    assert (draws[:, 0] < 0).mean() == pytest.approx(0.3, abs=0.03)


def test_one_stream_draws_the_same(raw):
    mixture = mixture_of(raw[0], 3, 0.05)
    assert (mixture.sample(np.random.default_rng(1)) == mixture.sample(np.random.default_rng(1))).all()
