"""Cutting planes without a grammar: the mixture head that the baselines share (IV-B1).

Input: the shape feature z of the fragment to cut and the embedding of the goal, which is learned together with the
head. Output: as for `PlaneNetwork`, a mixture of Gaussians over (n, d / scale) in the fragment's canonical frame.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.cutting.planes import MAX_NUMBER, plane_from
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.plane import Plane
from cutgrammar.nn.mixture import Mixture, mixture_of, numbers_of
from cutgrammar.nn.mlp import number_in, whole_in
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.perception.feature import scale_of


@dataclass(frozen=True, eq=False)
class GoalPlaneNetwork:
    """(z, goal) -> mixture of Gaussians over cutting planes.

    Attributes:
        components: Gaussians in the mixture.
        min_sigma: floor of their standard deviations.
        network: takes the fragment and the set of the goal's fragments.
    """

    components: int
    min_sigma: float
    network: SetNetwork

    def __post_init__(self) -> None:
        if self.network.sets != 1 or self.network.head.sizes[-1] != numbers_of(self.components, 4):
            raise ValueError(
                f"a network of {self.network.sets} sets and {self.network.head.sizes[-1]} outputs "
                f"does not make a mixture of {self.components} given the goal"
            )

    def mixture(self, z: Floats, z_goal: Floats) -> Mixture:
        """Mixture over (n, d / scale), for feature z (17,) of the fragment to cut and z_goal (any, 17) of the goal."""
        return mixture_of(self.network(z[None], z_goal)[0], self.components, self.min_sigma)

    def sample(self, z: Floats, z_goal: Floats, rng: np.random.Generator, draws: int = 1) -> Plane:
        """A plane [m] in the canonical frame C of the fragment with feature z (17,), by `plane_from`."""
        return plane_from(self.mixture(z, z_goal), scale_of(z), rng, draws)

    def to_bytes(self) -> bytes:
        """In the safetensors format."""
        return self.network.to_bytes(numbers=np.array([float(self.components), self.min_sigma]))

    @staticmethod
    def from_bytes(data: bytes) -> "GoalPlaneNetwork":
        """The inverse of `to_bytes`.

        Raises:
            ValueError: the data are not those of such a network.
        """
        network, others = SetNetwork.from_bytes(data)
        if set(others) != {"numbers"} or others["numbers"].shape != (2,):
            raise ValueError("not a network for cutting planes given the goal")
        components, min_sigma = whole_in(others, "numbers", 1, MAX_NUMBER), number_in(others, "numbers", 0.0, 1e3, 1)
        return GoalPlaneNetwork(components, min_sigma, network)
