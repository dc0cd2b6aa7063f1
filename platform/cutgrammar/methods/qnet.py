"""The offline deep Q network, the baseline `qnet` (IV-B1).

Q(z_i, s, s_g) is what cutting a fragment is worth on the way to the goal. The best fragment is cut, the first of
equals; the cutting plane is drawn as `bc` draws it.
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
    """The planner of `qnet`: all it needs is in the model."""
    del demonstration, parallel_map
    return ChoicePlanner(model.features, model.values, best, model.goal_planes, settings.cutting.draws)


def best(scores: Floats, rng: np.random.Generator) -> int:
    """The fragment with the greatest score of (n,), the first of equals; nothing is drawn."""
    del rng
    return int(np.argmax(scores))
