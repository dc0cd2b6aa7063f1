"""Networks that take a fragment and sets of fragments: the state embedding of IV-B1 and a head on top of it.

The embedding of a set of fragments is the sum of the projections of their shape features by an MLP. Each coordinate is
summed in ascending order, so the order of the fragments changes no bit.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.nn.mlp import MLP, from_bytes, from_named_arrays, named_arrays, to_bytes


@dataclass(frozen=True, eq=False)
class SetNetwork:
    """A fragment and sets of fragments -> outputs.

    Attributes:
        projection: z (17,) -> what is summed over a set (e,).
        head: z and the embeddings of the sets, one after another -> outputs.
    """

    projection: MLP
    head: MLP

    def __post_init__(self) -> None:
        size, embedding = self.projection.sizes[0], self.projection.sizes[-1]
        if self.head.sizes[0] <= size or (self.head.sizes[0] - size) % embedding:
            raise ValueError(
                f"a head of {self.head.sizes[0]} inputs does not take {size} features and embeddings of {embedding}"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        return SetNetwork, (self.projection, self.head)

    @property
    def sets(self) -> int:
        """Number of sets that it looks at."""
        return (self.head.sizes[0] - self.projection.sizes[0]) // self.projection.sizes[-1]

    def embed(self, z: Floats) -> Floats:
        """(e,) embedding of the set of fragments with features z (n, 17)."""
        return np.asarray(np.sort(self.projection(z), axis=0).sum(axis=0))

    def __call__(self, z: Floats, *sets: Floats) -> Floats:
        """(n, out) outputs for each fragment of z (n, 17), given the features (any, 17) of each set."""
        embeddings = [np.broadcast_to(self.embed(members), (len(z), self.projection.sizes[-1])) for members in sets]
        return self.head(np.concatenate([z, *embeddings], axis=1))

    def to_bytes(self, **others: Floats) -> bytes:
        """The network and other arrays in the safetensors format."""
        return to_bytes(self.head, **named_arrays(self.projection, "projection"), **others)

    @staticmethod
    def from_bytes(data: bytes) -> "tuple[SetNetwork, dict[str, Floats]]":
        """The inverse of `to_bytes`: the network and the other arrays.

        Raises:
            ValueError: the data are not those of such a network.
        """
        head, others = from_bytes(data)
        rest = {name: array for name, array in others.items() if not name.startswith("projection")}
        return SetNetwork(from_named_arrays(others, "projection"), head), rest
