"""The learned baselines `bc` and `qnet`, which choose a fragment by score and draw its cutting plane (IV-B1).

Each has a network that scores a current fragment from its shape feature and the embeddings of the current configuration
and of the goal. Behavioural cloning (`bc`) draws the fragment to cut with the softmax of the scores as probabilities.
For the offline deep Q network (`qnet`) the score is the value Q(z_i, s, s_g) of cutting the fragment on the way to the
goal, and the fragment with the highest value is cut. Both draw the plane from one mixture head.
"""

from collections.abc import Callable, Sequence

import numpy as np

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.cutting.planes import draws_left
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh
from cutgrammar.interfaces import Cut, Refusal, Stuck
from cutgrammar.methods.method import Method, PlanningContext
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


def by_probability(scores: Floats, rng: np.random.Generator) -> int:
    """A fragment drawn with the softmax of the scores (n,) as probabilities."""
    weights = np.exp(scores - scores.max())
    return int(rng.choice(len(scores), p=weights / weights.sum()))


def by_value(scores: Floats, rng: np.random.Generator) -> int:
    """The fragment with the greatest score of (n,), the first of equals; nothing is drawn."""
    del rng
    return int(np.argmax(scores))


def _planner(context: PlanningContext, scores: SetNetwork, choose: Choose) -> ChoicePlanner:
    model, draws = context.model, context.settings.cutting.n_draws
    return ChoicePlanner(model.features, scores, choose, model.goal_planes, draws)


BC = Method(
    "bc",
    lambda context: _planner(context, context.model.policy, by_probability),
    description="behavioural cloning of which fragment to cut; planes from a mixture given fragment and goal",
    kind="baseline",
    position=0,
)
QNET = Method(
    "qnet",
    lambda context: _planner(context, context.model.values, by_value),
    description="offline deep Q network with a large-margin loss; planes from the same mixture as bc",
    kind="baseline",
    position=1,
)
