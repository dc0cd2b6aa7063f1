"""Training of networks that look at sets of fragments, with torch; `to_network` makes a `SetNetwork` of one.

In every epoch each fragment is seen under one of the four flips of its canonical frame, whose signs are noise for many
fragments, and its z is jittered. A fragment looks the same wherever it takes part in that epoch, alone or within a set.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.mlp import common_deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Layers, forward, initialise, to_mlp
from cutgrammar.nn.set_network import SetNetwork


@dataclass(frozen=True, eq=False)
class Sets:
    """Sets of fragments as tensors.

    Attributes:
        members: (m, w) numbers of the fragments in each set, padded with 0.
        present: (m, w) which of them are members.
    """

    members: torch.Tensor
    present: torch.Tensor

    @staticmethod
    def of(sets: Sequence[Ints]) -> "Sets":
        """The sets with these members, each ascending."""
        sizes = np.array([len(one) for one in sets], dtype=np.int64)
        present = np.arange(max(int(sizes.max(initial=0)), 1)) < sizes[:, None]
        members = np.zeros(present.shape, dtype=np.int64)
        if len(sets):
            members[present] = np.concatenate(sets)
        return Sets(torch.tensor(members), torch.tensor(present))

    def at(self, rows: torch.Tensor) -> "Sets":
        """The sets with these numbers."""
        return Sets(self.members[rows], self.present[rows])


@dataclass(frozen=True, eq=False)
class TrainableSetNetwork:
    """A `SetNetwork` in training; it takes standardised features.

    Attributes:
        projection: z -> what is summed over a set.
        head: z and the embeddings of the sets -> outputs.
    """

    projection: Layers
    head: Layers

    @property
    def layers(self) -> Layers:
        """All layers, for an optimiser."""
        return [*self.projection, *self.head]

    def embed(self, z: torch.Tensor, sets: Sets) -> torch.Tensor:
        """(m, e) embeddings of m sets, given the features z (n, 17) of all fragments."""
        projected = torch.nn.functional.embedding(sets.members, forward(self.projection, z))
        return (projected * sets.present[..., None]).sum(dim=1)

    def __call__(self, *inputs: torch.Tensor) -> torch.Tensor:
        """(..., out) outputs for z (..., 17) and embeddings (..., e)."""
        return forward(self.head, torch.cat(inputs, dim=-1))

    def frozen_copy(self) -> "TrainableSetNetwork":
        """A copy of the current weights that training does not change."""
        return TrainableSetNetwork(
            *([(w.detach().clone(), b.detach().clone()) for w, b in part] for part in (self.projection, self.head))
        )

    def to_network(self, mean: Floats, deviation: Floats) -> SetNetwork:
        """The network with the current weights, for features (17,) of this mean and deviation."""
        n_embedded = self.head[0][0].shape[0] - len(mean)
        return SetNetwork(
            with_standardised_inputs(to_mlp(self.projection), mean, deviation),
            with_standardised_inputs(
                to_mlp(self.head), np.append(mean, np.zeros(n_embedded)), np.append(deviation, np.ones(n_embedded))
            ),
        )


def initialise_set_network(
    n_inputs: int,
    hidden_size: int,
    embedding_size: int,
    n_sets: int,
    n_outputs: int,
    mean_set_size: float,
    rng: np.random.Generator,
) -> TrainableSetNetwork:
    """Random layers; the embedding of a set of `mean_set_size` fragments varies about as much as one feature."""
    projection = initialise((n_inputs, hidden_size, embedding_size), rng)
    with torch.no_grad():
        projection[-1][0].mul_(1.0 / mean_set_size)
    return TrainableSetNetwork(
        projection, initialise((n_inputs + n_sets * embedding_size, hidden_size, n_outputs), rng)
    )


@dataclass(frozen=True, eq=False)
class AugmentedFeatures:
    """The features of fragments as a network in training sees them.

    Attributes:
        z: (n, 4, 17) standardised features under each of `FLIPS`.
        jitter: standard deviation of the noise, in units of the features' own deviation.
        generator: draws flips and noise.
    """

    z: torch.Tensor
    jitter: float
    generator: torch.Generator

    def sample(self) -> torch.Tensor:
        """(n, 17) each fragment under a random flip of its own, jittered."""
        count, flips, size = self.z.shape
        flip = torch.randint(flips, (count,), generator=self.generator)
        noise = self.jitter * torch.randn((count, size), generator=self.generator)
        return self.z[torch.arange(count), flip] + noise

    def flips(self) -> list[torch.Tensor]:
        """(n, 17) all fragments under the first flip, under the second, and so on, without noise."""
        return list(self.z.unbind(dim=1))


def mean_and_deviation(z: Floats, fragments: Ints) -> tuple[Floats, Floats]:
    """Mean (17,) and common deviation (17,) of the features z (n, 4, 17) of these fragments under all flips."""
    rows = z[fragments].reshape(-1, z.shape[-1])
    return rows.mean(axis=0), common_deviation_of(rows)
