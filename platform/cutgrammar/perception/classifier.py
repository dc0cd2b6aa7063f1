"""The fragment-type classifier p(c|z) (II-B): a two-layer MLP, calibrated.

"Two-layer" is read as one hidden layer and the output layer. A type without training fragments has no output; it gets
the minimum probability that every type has.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.nn.mlp import MLP, from_bytes, number_in, to_bytes, whole_in

FLOOR = 1e-6
"""Share of the probability that is distributed uniformly over all types."""
MAX_TYPES = 10_000
"""Largest number of types in a file."""


@dataclass(frozen=True, eq=False)
class TypeClassifier:
    """p(c|z) for types c = 0 to k - 1.

    Attributes:
        k: number of fragment types.
        layers: z (the first layer includes the standardisation) -> one logit for each of `seen`.
        seen: the types that had training fragments, ascending.
        temperature: divides the logits.
    """

    k: int
    layers: MLP
    seen: tuple[int, ...]
    temperature: float

    def log_probabilities(self, z: Floats) -> Floats:
        """(n, k) log p(c|z) of features (n, 17); all entries are finite, and the probabilities of a row sum to 1."""
        return log_probabilities(self.layers(np.atleast_2d(z)) / self.temperature, self.seen, self.k)

    def to_bytes(self) -> bytes:
        """Serialise to the safetensors format."""
        seen = np.array(self.seen, dtype=np.float64)
        return to_bytes(self.layers, k=np.array([float(self.k)]), seen=seen, temperature=np.array([self.temperature]))

    @staticmethod
    def from_bytes(data: bytes) -> "TypeClassifier":
        """The inverse of `to_bytes`.

        Raises:
            ValueError: the bytes are not a classifier.
        """
        layers, others = from_bytes(data)
        if set(others) != {"k", "seen", "temperature"} or others["seen"].shape != layers.sizes[-1:]:
            raise ValueError("not a classifier of fragment types")
        k = whole_in(others, "k", 1, MAX_TYPES)
        seen = tuple(whole_in(others, "seen", 0, k - 1, place) for place in range(layers.sizes[-1]))
        if any(a >= b for a, b in pairwise(seen)):
            raise ValueError("the types in seen are not ascending")
        return TypeClassifier(k, layers, seen, number_in(others, "temperature", 1e-6, 1e6))


def log_probabilities(logits: Floats, seen: tuple[int, ...], k: int) -> Floats:
    """(n, k) log p(c|z) from the logits (n, len(seen)) of the types in `seen`; the other types get the minimum."""
    shifted = logits - logits.max(axis=1, keepdims=True)
    log_p = shifted - np.log(np.exp(shifted).sum(axis=1, keepdims=True))
    floor = np.log(FLOOR / k)
    result = np.full((len(logits), k), floor)
    result[:, list(seen)] = np.logaddexp(np.log1p(-FLOOR) + log_p, floor)
    return result
