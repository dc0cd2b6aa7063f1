"""Training of multi-layer perceptrons with torch; `to_mlp` makes an `MLP` of the trained layers."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TypeVar

import numpy as np
import torch

from cutgrammar.geometry.arrays import Floats
from cutgrammar.nn.mlp import MLP

T = TypeVar("T")

Layers = list[tuple[torch.Tensor, torch.Tensor]]
"""Weights (in, out) and biases (out,) of each layer in training."""


def initialise(sizes: Sequence[int], rng: np.random.Generator) -> Layers:
    """Random layers in single precision that keep the variance of rectified signals (He et al. 2015).

    Args:
        sizes: number of inputs, of units in each hidden layer, and of outputs.
        rng: draws the weights.
    """
    layers = []
    for inputs, outputs in pairwise(sizes):
        weight = rng.normal(scale=np.sqrt(2.0 / inputs), size=(inputs, outputs))
        layers.append((_parameter(weight), _parameter(np.zeros(outputs))))
    return layers


def forward(layers: Layers, x: torch.Tensor) -> torch.Tensor:
    """Outputs (..., out) for inputs (..., in); hidden layers are rectified, the last one is linear."""
    for i, (weight, bias) in enumerate(layers):
        x = x @ weight + bias
        if i < len(layers) - 1:
            x = torch.relu(x)
    return x


def to_mlp(layers: Layers) -> MLP:
    """The network with the current weights."""
    pairs = [(w.detach().double().numpy(), b.detach().double().numpy()) for w, b in layers]
    return MLP(tuple(w for w, _ in pairs), tuple(b for _, b in pairs))


def fit(
    layers: Layers,
    loss: Callable[[], torch.Tensor],
    n_epochs: int,
    learning_rate: float,
    weight_decay: float,
    validate: Callable[[], T] | None = None,
) -> list[T]:
    """Train `layers` in place by AdamW, one step an epoch.

    Args:
        layers: what is trained.
        loss: the training loss with the current weights.
        n_epochs: number of steps.
        learning_rate: of AdamW.
        weight_decay: of AdamW.
        validate: measures the current network, without gradients.

    Returns:
        What `validate` measured after each epoch; empty without it.
    """
    optimiser = torch.optim.AdamW(parameters_of(layers), lr=learning_rate, weight_decay=weight_decay)
    measured = []
    for _ in range(n_epochs):
        optimiser.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        if validate is not None:
            with torch.no_grad():
                measured.append(validate())
    return measured


def batches(count: int, batch_size: int, generator: torch.Generator) -> Callable[[], torch.Tensor]:
    """Each call gives the rows of one step: all `count` of them, or `batch_size` drawn without replacement."""
    everything = torch.arange(count)
    if count <= batch_size:
        return lambda: everything
    return lambda: torch.randperm(count, generator=generator)[:batch_size]


def parameters_of(layers: Layers) -> list[torch.Tensor]:
    """All weights and biases, for an optimiser."""
    return [tensor for pair in layers for tensor in pair]


@contextmanager
def deterministic() -> Iterator[None]:
    """Within it, torch runs on one thread with deterministic algorithms, so that one seed gives the same bits."""
    threads, was_deterministic = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.use_deterministic_algorithms(was_deterministic)


def _parameter(values: Floats) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32, requires_grad=True)
