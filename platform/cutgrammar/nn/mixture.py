"""Mixtures of Gaussians with independent coordinates, and the outputs of a network that stand for one (Bishop 1994)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats


@dataclass(frozen=True, eq=False)
class Mixture:
    """A mixture of m Gaussians in d dimensions.

    Attributes:
        weights: (m,) probabilities of the Gaussians; they sum to 1.
        means: (m, d) means.
        sigmas: (m, d) standard deviations.
    """

    weights: Floats
    means: Floats
    sigmas: Floats

    def __post_init__(self) -> None:
        means = frozen_floats(self.means, (None, None), "means")
        object.__setattr__(self, "weights", frozen_floats(self.weights, (len(means),), "weights"))
        object.__setattr__(self, "means", means)
        object.__setattr__(self, "sigmas", frozen_floats(self.sigmas, (len(means), means.shape[1]), "sigmas"))

    def __reduce__(self) -> tuple[Any, ...]:
        return Mixture, (self.weights, self.means, self.sigmas)

    def sample(self, rng: np.random.Generator) -> Floats:
        """(d,) a sample: first a component is drawn, then a point of its Gaussian."""
        below = np.cumsum(self.weights)
        chosen = min(int(np.searchsorted(below, rng.random() * below[-1], side="right")), len(below) - 1)
        return np.asarray(self.means[chosen] + self.sigmas[chosen] * rng.normal(size=self.means.shape[1]))

    def log_density(self, points: Floats) -> Floats:
        """(n,) log density at points (n, d)."""
        off = (points[:, None, :] - self.means) / self.sigmas
        parts = -0.5 * (off**2).sum(axis=2) - np.log(self.sigmas * np.sqrt(2.0 * np.pi)).sum(axis=1)
        return np.asarray(np.logaddexp.reduce(parts + np.log(self.weights), axis=1))

    def log_folded(self, points: Floats) -> Floats:
        """(n,) log density of points (n, d), with x and -x the same point, as (n, d) and (-n, -d) are one plane."""
        return np.asarray(np.logaddexp(self.log_density(points), self.log_density(-points)))


def numbers_of(components: int, dimensions: int) -> int:
    """Number of outputs of a network for a mixture."""
    return components * (1 + 2 * dimensions)


def mixture_of(raw: Floats, components: int, min_sigma: float) -> Mixture:
    """The mixture that outputs (numbers_of(m, d),) stand for: logits, means, and sigmas before a softplus."""
    logits, means, widths = parts_of(raw, components)
    weights = np.exp(logits - logits.max())
    weights = np.maximum(weights / weights.sum(), 1e-300)
    return Mixture(weights / weights.sum(), means, min_sigma + np.logaddexp(0.0, widths))


def parts_of(raw: Any, components: int) -> tuple[Any, Any, Any]:
    """Logits (..., m), means (..., m, d) and widths (..., m, d), for arrays and for tensors."""
    d = (raw.shape[-1] // components - 1) // 2
    shape = (*raw.shape[:-1], components, d)
    end = components * (1 + d)
    return raw[..., :components], raw[..., components:end].reshape(shape), raw[..., end:].reshape(shape)
