"""Behavioural cloning, the baseline `bc` (IV-B1).

A policy scores each current fragment from its shape feature and the embeddings of the current configuration and of the
goal. The fragment to cut is drawn with the softmax of these scores as probabilities.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.methods.fragment_choice import ChoicePlanner
from cutgrammar.methods.method import Method, PlanningContext


def by_probability(scores: Floats, rng: np.random.Generator) -> int:
    """A fragment drawn by the softmax of the scores (n,)."""
    weights = np.exp(scores - scores.max())
    return int(rng.choice(len(scores), p=weights / weights.sum()))


def make_planner(context: PlanningContext) -> ChoicePlanner:
    """The planner of `bc`."""
    model, draws = context.model, context.settings.cutting.n_draws
    return ChoicePlanner(model.features, model.policy, by_probability, model.goal_planes, draws)


BC = Method(
    "bc",
    make_planner,
    description="behavioural cloning of which fragment to cut; planes from a mixture given fragment and goal",
    kind="baseline",
    position=0,
)
