"""Multi-layer perceptrons while they are trained, with torch; `finished` makes `MLP` of them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import torch

from cutgrammar.geometry.arrays import Floats
from cutgrammar.nn.mlp import MLP

Parameters = list[tuple[torch.Tensor, torch.Tensor]]
"""Weights (in, out) and biases (out,) of each layer while they are trained."""


def initial(sizes: Sequence[int], rng: np.random.Generator) -> Parameters:
    """Random layers that keep the variance of rectified signals (He et al.); single precision."""
    layers = []
    for inputs, outputs in pairwise(sizes):
        weight = rng.normal(scale=np.sqrt(2.0 / inputs), size=(inputs, outputs))
        layers.append((_leaf(weight), _leaf(np.zeros(outputs))))
    return layers


def forward(layers: Parameters, x: torch.Tensor) -> torch.Tensor:
    """Outputs (..., out) for inputs (..., in), while the layers are trained."""
    for i, (weight, bias) in enumerate(layers):
        x = x @ weight + bias
        if i < len(layers) - 1:
            x = torch.relu(x)
    return x


def finished(layers: Parameters) -> MLP:
    """The layers as they are now."""
    pairs = [(w.detach().double().numpy(), b.detach().double().numpy()) for w, b in layers]
    return MLP(tuple(w for w, _ in pairs), tuple(b for _, b in pairs))


def descend(
    layers: Parameters,
    loss: Callable[[], torch.Tensor],
    epochs: int,
    learning_rate: float,
    weight_decay: float,
    after_epoch: Callable[[], Any] | None = None,
) -> None:
    """Change `layers` in `epochs` full steps of AdamW down `loss`; `after_epoch` is called after each of them."""
    optimiser = torch.optim.AdamW(tensors_of(layers), lr=learning_rate, weight_decay=weight_decay)
    for _ in range(epochs):
        optimiser.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        if after_epoch is not None:
            with torch.no_grad():
                after_epoch()


def tensors_of(layers: Parameters) -> list[torch.Tensor]:
    """All weights and biases, for an optimiser."""
    return [tensor for pair in layers for tensor in pair]


@contextmanager
def one_thread() -> Iterator[None]:
    """Within: torch on one thread with deterministic algorithms, so that the same seed gives the same bits."""
    threads, deterministic = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.use_deterministic_algorithms(deterministic)


def _leaf(values: Floats) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32, requires_grad=True)
