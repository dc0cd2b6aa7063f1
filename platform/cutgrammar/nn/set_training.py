"""Networks that look at sets of fragments while they are trained, with torch; `finished` makes a `SetNetwork` of one.

In every epoch each fragment is seen under one of the four flips of its canonical frame, whose signs are noise for many
fragments, and its z is jittered; wherever it takes part in that epoch, alone or within a set, it looks the same.
"""

from dataclasses import dataclass

import numpy as np
import torch

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn import mlp_training as descent
from cutgrammar.nn.mlp import deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Parameters
from cutgrammar.nn.set_network import SetNetwork


@dataclass(frozen=True, eq=False)
class SetParameters:
    """A network while it is trained; features are standardised before they reach it.

    Attributes:
        projection: z -> what is summed over a set.
        head: z and the embeddings of the sets -> outputs.
    """

    projection: Parameters
    head: Parameters

    @property
    def layers(self) -> Parameters:
        """All of them, for an optimiser."""
        return [*self.projection, *self.head]

    def embed(self, z: torch.Tensor, members: torch.Tensor) -> torch.Tensor:
        """(m, e) embeddings of m sets, given the features z (n, 17) and which of them (m, n) are in each set."""
        return members @ descent.forward(self.projection, z)

    def __call__(self, *inputs: torch.Tensor) -> torch.Tensor:
        """(r, out) outputs for z (r, 17) and embeddings (r, e)."""
        return descent.forward(self.head, torch.cat(inputs, dim=1))

    def copied(self) -> "SetParameters":
        """As it is now; it does not change any more."""
        return SetParameters(
            *([(w.detach().clone(), b.detach().clone()) for w, b in part] for part in (self.projection, self.head))
        )

    def finished(self, mean: Floats, deviation: Floats) -> SetNetwork:
        """The network as it is now, for features (17,) with this mean and deviation."""
        wide = self.head[0][0].shape[0] - len(mean)
        return SetNetwork(
            with_standardised_inputs(descent.finished(self.projection), mean, deviation),
            with_standardised_inputs(
                descent.finished(self.head), np.append(mean, np.zeros(wide)), np.append(deviation, np.ones(wide))
            ),
        )


def initial_set(
    size: int, hidden: int, embedding: int, sets: int, outputs: int, members: float, rng: np.random.Generator
) -> SetParameters:
    """Random layers; the embedding of a set of about `members` fragments varies as much as one feature."""
    projection = descent.initial((size, hidden, embedding), rng)
    with torch.no_grad():
        projection[-1][0].mul_(1.0 / members)
    return SetParameters(projection, descent.initial((size + sets * embedding, hidden, outputs), rng))


@dataclass(frozen=True, eq=False)
class Appearances:
    """The features of fragments as a network in training sees them.

    Attributes:
        z: (n, 4, 17) standardised features under each of `FLIPS`.
        jitter: standard deviation of the noise, in units of the features' own deviation.
        generator: draws flips and noise.
    """

    z: torch.Tensor
    jitter: float
    generator: torch.Generator

    def drawn(self) -> torch.Tensor:
        """(n, 17) each fragment under a flip of its own, jittered."""
        count, flips, size = self.z.shape
        flip = torch.randint(flips, (count,), generator=self.generator)
        noise = self.jitter * torch.randn((count, size), generator=self.generator)
        return self.z[torch.arange(count), flip] + noise

    def held_out(self) -> list[torch.Tensor]:
        """(n, 17) all fragments under the first flip, under the second, and so on, without noise."""
        return list(self.z.unbind(dim=1))


def standard(z: Floats, fragments: Ints) -> tuple[Floats, Floats]:
    """Mean (17,) and deviation (17,) of the features z (n, 4, 17) of these fragments under all flips."""
    rows = z[fragments].reshape(-1, z.shape[-1])
    return rows.mean(axis=0), deviation_of(rows)
