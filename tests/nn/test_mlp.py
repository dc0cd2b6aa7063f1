import numpy as np
import pytest
import torch

from cutgrammar.nn.mlp import (
    MLP,
    deviation_of,
    from_bytes,
    to_bytes,
    with_standardised_inputs,
)
from cutgrammar.nn.mlp_training import batches, deterministic, forward, initialise, to_mlp


@pytest.fixture
def network(rng):
    return to_mlp(initialise((5, 16, 8, 3), rng))


def test_a_row_has_the_same_bits_alone_and_in_any_batch(network, rng):
    x = rng.normal(size=(37, 5))
    together = network(x)
    assert (together == np.concatenate([network(row[None]) for row in x])).all()
    assert (together[::-1] == network(x[::-1])).all()


def test_inference_agrees_with_training(rng):
    layers = initialise((5, 16, 3), rng)
    x = rng.normal(size=(10, 5))
    outputs = forward(layers, torch.tensor(x, dtype=torch.float32)).detach().numpy()
    assert np.abs(outputs - to_mlp(layers)(x)).max() < 1e-5


def test_standardising_can_be_folded_into_the_first_layer(network, rng):
    x = rng.normal(3.0, 7.0, size=(20, 5))
    mean, deviation = x.mean(axis=0), deviation_of(x)
    folded = with_standardised_inputs(network, mean, deviation)
    assert folded(x) == pytest.approx(network((x - mean) / deviation), abs=1e-9)


def test_an_input_that_never_changes_has_deviation_one():
    assert deviation_of(np.array([[1.0, 2.0], [1.0, 4.0]])).tolist() == [1.0, 1.0]


def test_networks_can_be_read_from_their_bytes_which_are_always_the_same(network):
    again, others = from_bytes(to_bytes(network, extra=np.arange(3.0)))
    assert again.sizes == (5, 16, 8, 3)
    assert to_bytes(again, **others) == to_bytes(network, extra=np.arange(3.0))


def test_layers_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="biases"):
        MLP((np.zeros((2, 3)),), (np.zeros(2),))
    with pytest.raises(ValueError, match="one another"):
        MLP((np.zeros((2, 3)), np.zeros((4, 1))), (np.zeros(3), np.zeros(1)))


def test_torch_gets_its_threads_back():
    threads = torch.get_num_threads()
    with deterministic():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == threads


def test_a_step_has_all_rows_or_a_new_draw_of_some():
    generator = torch.Generator().manual_seed(0)
    everything, some = batches(10, 10, generator), batches(100, 10, generator)
    assert everything().tolist() == everything().tolist() == list(range(10))
    first, second = some().tolist(), some().tolist()
    assert len(set(first)) == len(set(second)) == 10
    assert first != second
