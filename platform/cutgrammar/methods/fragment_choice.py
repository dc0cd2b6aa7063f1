"""The planner of the baselines: it chooses a fragment by score and cuts it with a plane of the mixture head (IV-B1).

`bc` and `qnet` differ in the network that scores the fragments and in how a fragment is chosen by these scores.
"""

from collections.abc import Callable, Sequence

import numpy as np

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.cutting.planes import draws_left
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.shape_cache import ShapeCache
from cutgrammar.nn.set_network import SetNetwork

Choose = Callable[[Floats, np.random.Generator], int]
"""(scores (n,), rng) -> index of the fragment to cut."""


class ChoicePlanner:
    """Chooses a fragment, then a plane, anew after every cut and every refusal."""

    def __init__(
        self,
        features: Callable[[Mesh | Cloud], Floats],
        scores: SetNetwork,
        choose: Choose,
        planes: GoalPlaneNetwork,
        draws: int,
    ) -> None:
        self._features = ShapeCache(features)
        self._scores = scores
        self._choose = choose
        self._planes = planes
        self._draws = draws

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The next cut on the way from `now` to `goal` (see `Planner`); refusals only reduce the number of draws."""
        if len(now) >= len(goal):
            return Stuck(f"there are {len(now)} fragments already and the goal has {len(goal)}")
        z_now, z_goal = self._features(now, goal)
        chosen = self._choose(self._scores(z_now, z_now, z_goal)[:, 0], rng)
        fragment = now[chosen]
        plane_C = self._planes.sample(z_now[chosen], z_goal, rng, draws_left(self._draws, len(refused)))
        return Cut.of_fragment(fragment, plane_C, canonical_frame(fragment.shape))
