"""Behavioural cloning, the baseline `bc` (IV-B1).

A policy gives each current fragment a score from its shape feature and the embeddings of the current configuration and
of the goal. The fragment to cut is drawn with the probabilities that are the softmax of these scores.
"""

from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.interfaces import ParallelMap, run_serially
from cutgrammar.methods.fragment_choice import ChoicePlanner
from cutgrammar.settings import Settings

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model


def make_planner(
    model: "Model",
    settings: Settings,
    demonstration: Demonstration | None = None,
    parallel_map: ParallelMap = run_serially,
) -> ChoicePlanner:
    """The planner of `bc`: all it needs is in the model."""
    del demonstration, parallel_map
    return ChoicePlanner(model.features, model.policy, by_probability, model.goal_planes, settings.cutting.draws)


def by_probability(scores: Floats, rng: np.random.Generator) -> int:
    """A fragment drawn by the softmax of the scores (n,)."""
    weights = np.exp(scores - scores.max())
    return int(rng.choice(len(scores), p=weights / weights.sum()))
