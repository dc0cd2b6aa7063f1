"""The offline deep Q network, the baseline `qnet` (IV-B1).

Q(z_i, s, s_g) is the value of cutting a fragment on the way to the goal. The fragment with the highest value is cut,
the first of equals. The cutting plane is drawn as in `bc`.
"""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.methods.fragment_choice import ChoicePlanner
from cutgrammar.methods.method import Method, PlanningContext


def best(scores: Floats, rng: np.random.Generator) -> int:
    """The fragment with the greatest score of (n,), the first of equals; nothing is drawn."""
    del rng
    return int(np.argmax(scores))


def make_planner(context: PlanningContext) -> ChoicePlanner:
    """The planner of `qnet`."""
    model, draws = context.model, context.settings.cutting.n_draws
    return ChoicePlanner(model.features, model.values, best, model.goal_planes, draws)


QNET = Method(
    "qnet",
    make_planner,
    description="offline deep Q network with a large-margin loss; planes from the same mixture as bc",
    kind="baseline",
    position=1,
)
