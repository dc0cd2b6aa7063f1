"""What the baselines `bc` and `qnet` learn from the training trials (IV-B1)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.learning.fragment_choice_training import BC, QNET, ChoiceValidation, fit_choice
from cutgrammar.learning.goal_plane_training import GOAL_PLANES, fit_goal_planes
from cutgrammar.learning.plane_validation import PlaneValidation
from cutgrammar.learning.steps import Steps
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.settings import Settings


@dataclass(frozen=True, eq=False)
class Baselines:
    """The networks of `bc` and `qnet` and how they were trained (IV-B1).

    Attributes:
        policy: by which `bc` chooses a fragment.
        values: by which `qnet` chooses a fragment.
        goal_planes: the plane head of both.
        choices: held-out losses and accuracies of `policy` and `values`, by method.
        cutting: held-out losses of `goal_planes`.
    """

    policy: SetNetwork
    values: SetNetwork
    goal_planes: GoalPlaneNetwork
    choices: dict[str, ChoiceValidation]
    cutting: PlaneValidation

    @property
    def metrics(self) -> dict[str, float | None]:
        """What was measured in training, by name; None where nothing could be held out."""
        of_choices = {
            name: value for method, choice in self.choices.items() for name, value in choice.metrics(method).items()
        }
        return of_choices | self.cutting.metrics(GOAL_PLANES)


def learn_baselines(steps: Steps, settings: Settings, seed: int, watch: Callable[[str, int, int], Any]) -> Baselines:
    """Train the networks of `bc` and `qnet` on the steps of the training trials (IV-B1).

    Args:
        steps: the steps.
        settings: of the baselines, and of the mixtures of planes.
        seed: of the training.
        watch: called with the name of a network, how much of its training is done, and of how much.
    """
    own = settings.baselines
    policy, of_policy = fit_choice(steps, BC, own, seed, partial(watch, BC))
    values, of_values = fit_choice(steps, QNET, own, seed, partial(watch, QNET))
    planes, cutting = fit_goal_planes(steps, own, settings.planes, seed, partial(watch, GOAL_PLANES))
    return Baselines(policy, values, planes, {BC: of_policy, QNET: of_values}, cutting)
