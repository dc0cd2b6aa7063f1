from itertools import pairwise

import numpy as np
import pytest
import torch

from cutgrammar.nn.mlp import MLP, to_bytes
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.nn.set_training import Sets, initialise_set_network, mean_and_deviation


def network(sets=2, embedding=5):
    def layers(*sizes):
        rng = np.random.default_rng(0)
        return MLP(
            tuple(rng.normal(size=shape) for shape in pairwise(sizes)), tuple(rng.normal(size=n) for n in sizes[1:])
        )

    return SetNetwork(layers(17, 8, embedding), layers(17 + sets * embedding, 8, 3))


@pytest.fixture
def z():
    return np.random.default_rng(1).normal(size=(6, 17))


def test_the_order_of_a_set_changes_no_bit(z):
    order = np.random.default_rng(2).permutation(6)
    assert network().embed(z).tobytes() == network().embed(z[order]).tobytes()
    assert network()(z[:2], z, z).tobytes() == network()(z[:2], z[order], z[order[::-1]]).tobytes()


def test_a_set_is_embedded_as_the_sum_of_its_members(z):
    parts = [network().embed(z[i : i + 1]) for i in range(6)]
    assert network().embed(z) == pytest.approx(np.sum(parts, axis=0))


def test_the_outputs_of_a_fragment_do_not_depend_on_the_rest_of_the_batch(z):
    together = network()(z, z[:3], z)
    assert all((network()(z[i : i + 1], z[:3], z)[0] == together[i]).all() for i in range(6))


def test_the_outputs_depend_on_the_order_of_the_sets(z):
    assert (network()(z, z[:3], z) != network()(z, z, z[:3])).any()


def test_a_network_can_be_read_from_its_bytes():
    again, others = SetNetwork.from_bytes(network().to_bytes(numbers=np.ones(2)))
    assert again.to_bytes(numbers=np.ones(2)) == network().to_bytes(numbers=np.ones(2))
    assert (again.sets, list(others)) == (2, ["numbers"])


def test_bytes_of_another_network_and_heads_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="lacks projection0.weight"):
        SetNetwork.from_bytes(to_bytes(network().head))
    with pytest.raises(ValueError, match="does not take"):
        SetNetwork(network().projection, network(embedding=4).head)


def test_a_network_trained_on_standardised_features_gives_the_same_outputs_for_plain_ones(z):
    features = np.repeat(3.0 + 2.0 * z[:, None], 4, axis=1)
    mean, deviation = mean_and_deviation(features, np.arange(6))
    trained = initialise_set_network(17, 8, 5, 1, 2, 3.0, np.random.default_rng(3))
    inputs = torch.tensor((features[:, 0] - mean) / deviation, dtype=torch.float32)
    members = Sets.of([np.array([0, 1, 3])])
    expected = trained(inputs, trained.embed(inputs, members).repeat(6, 1)).detach().numpy()
    plain = trained.to_network(mean, deviation)(features[:, 0], features[[0, 1, 3], 0])
    assert plain == pytest.approx(expected, abs=1e-5)


def test_sets_of_different_sizes_are_embedded_as_the_sums_of_their_members(z):
    trained = initialise_set_network(17, 8, 5, 1, 2, 3.0, np.random.default_rng(3))
    flags = np.array([[1, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0], [1, 1, 1, 0, 1, 0]], dtype=bool)
    inputs = torch.tensor(z, dtype=torch.float32)
    alone = trained.embed(inputs, Sets.of(np.arange(6)[:, None])).detach().numpy()
    sets = Sets.of([np.flatnonzero(row) for row in flags])
    together = trained.embed(inputs, sets).detach().numpy()
    assert together == pytest.approx(flags @ alone, abs=1e-5)
    chosen = trained.embed(inputs, sets.at(torch.tensor([2, 0]))).detach().numpy()
    assert chosen == pytest.approx(together[[2, 0]])
