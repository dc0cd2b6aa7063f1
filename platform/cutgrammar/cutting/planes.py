"""Cutting planes by a mixture density network (III-C).

Input: the production r (one-hot of the parent type, counts of the child types) and the shape feature z of the fragment
to cut. Output: a mixture of Gaussians over pi = [n, d] in the canonical frame of that fragment, d divided by its scale.
Of several draws the one with the most neighbours is taken (`CuttingSettings.n_draws`), because a single draw from a
mixture fitted to a hundred cuts is often unlike all of them.
"Two-layer" is read as one hidden layer and the output layer. A draw of n is normalised. d is taken as drawn, because in
training it was the distance of a plane with a unit normal.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.production import Production
from cutgrammar.nn.mixture import Mixture, mixture_of, numbers_of
from cutgrammar.nn.mlp import MLP, from_bytes, number_in, to_bytes, whole_in
from cutgrammar.perception.feature import scale_of

NEIGHBOUR_DISTANCE = 0.2
"""Length scale, in (n, d / scale), of the weight with which planes count as neighbours."""

MAX_NUMBER = 10_000
"""Largest number of types, and of components of a mixture, in a file."""


@dataclass(frozen=True, eq=False)
class PlaneNetwork:
    """(production, z) -> mixture of Gaussians over cutting planes.

    Attributes:
        k: number of fragment types.
        components: Gaussians in the mixture.
        min_sigma: floor of their standard deviations.
        layers: the network.
    """

    k: int
    components: int
    min_sigma: float
    layers: MLP

    def mixture(self, production: Production, z: Floats) -> Mixture:
        """Mixture over (n, d / scale), in the canonical frame of the fragment with feature z (17,).

        The production need not occur in the training cuts.
        """
        raw = self.layers(inputs_of(production, z, self.k)[None])[0]
        return mixture_of(raw, self.components, self.min_sigma)

    def sample(self, production: Production, z: Floats, rng: np.random.Generator, draws: int = 1) -> Plane:
        """A plane [m] in the canonical frame C of the fragment with feature z (17,), by `plane_from`."""
        return plane_from(self.mixture(production, z), scale_of(z), rng, draws)

    def to_bytes(self) -> bytes:
        """In the safetensors format."""
        return to_bytes(self.layers, numbers=np.array([float(self.k), float(self.components), self.min_sigma]))

    @staticmethod
    def from_bytes(data: bytes) -> "PlaneNetwork":
        """The inverse of `to_bytes`.

        Raises:
            ValueError: the data are not those of such a network.
        """
        layers, others = from_bytes(data)
        if set(others) != {"numbers"} or others["numbers"].shape != (3,):
            raise ValueError("not a network for cutting planes")
        k, components = (whole_in(others, "numbers", 1, MAX_NUMBER, place) for place in range(2))
        if layers.sizes[-1] != numbers_of(components, 4):
            raise ValueError(f"{layers.sizes[-1]} outputs do not make a mixture of {components}")
        return PlaneNetwork(k, components, number_in(others, "numbers", 0.0, 1e3, 2), layers)


def plane_from(mixture: Mixture, scale: float, rng: np.random.Generator, draws: int = 1) -> Plane:
    """Draw a plane [m] from a mixture over (n, d / scale); all plane heads are drawn from in this way.

    Args:
        mixture: the output of a plane head.
        scale: of the fragment to cut [m].
        rng: random stream.
        draws: number of planes drawn, of which the one with the most neighbours is taken.
    """
    drawn = draw_planes(mixture, rng, draws)
    best = drawn[_most_central(drawn)]
    return Plane(best[:3], float(best[3]) * scale)


def draw_planes(mixture: Mixture, rng: np.random.Generator, draws: int) -> Floats:
    """(draws, 4) planes (n, d / scale) with unit normals, drawn from a mixture."""
    drawn: list[Floats] = []
    while len(drawn) < draws:
        numbers = mixture.sample(rng)
        length = float(np.linalg.norm(numbers[:3]))
        if length > 1e-3:
            drawn.append(np.append(numbers[:3] / length, numbers[3]))
    return np.array(drawn)


def _most_central(planes: Floats) -> int:
    """Index of the plane of (m, 4) with the most neighbours; the first of equals.

    The mode of the mixture is not used, because a narrow component of little weight is denser than a broad one.
    """
    return int(np.argmax(neighbours(planes, planes)))


def neighbours(planes: Floats, drawn: Floats) -> Floats:
    """(m,) weighted number of the planes `drawn` (n, 4) near each of `planes` (m, 4), (n, d) and (-n, -d) being one."""
    squares = [((planes[:, None] - sign * drawn) ** 2).sum(axis=2) for sign in (1.0, -1.0)]
    return np.asarray(np.exp(-0.5 * np.minimum(*squares) / NEIGHBOUR_DISTANCE**2).sum(axis=1))


def draws_left(draws: int, refusals: int) -> int:
    """Number of planes drawn after `refusals` in a step; each halves it, so that other planes are chosen."""
    return max(draws >> refusals, 1)


def inputs_of(production: Production, z: Floats, k: int) -> Floats:
    """(2 k + 17,): one-hot of the parent, counts of the children, z."""
    parent = np.zeros(k)
    parent[production.parent] = 1.0
    return np.concatenate([parent, np.bincount(production.children, minlength=k).astype(np.float64), z])
