"""What the baselines `bc` and `qnet` learn from the training trials (IV-B1)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.learning.fragment_choice_training import BC, QNET, ChoiceValidation, cross_validate_choice, fit_choice
from cutgrammar.learning.goal_plane_training import GOAL_PLANES, cross_validate_goal_planes, fit_goal_planes
from cutgrammar.learning.plane_training import PlaneValidation
from cutgrammar.learning.steps import Steps
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.settings import Settings


@dataclass(frozen=True, eq=False)
class Baselines:
    """The networks of `bc` and `qnet` and how they came about (IV-B1).

    Attributes:
        policy, values: what they choose a fragment by.
        goal_planes: the plane head they share.
        choices: held-out curves and accuracies of `policy` and `values`, by method.
        cutting: held-out curve of `goal_planes`.
    """

    policy: SetNetwork
    values: SetNetwork
    goal_planes: GoalPlaneNetwork
    choices: dict[str, ChoiceValidation]
    cutting: PlaneValidation

    @property
    def measured(self) -> dict[str, float | None]:
        """What was measured in training, by name; None where nothing could be held out."""
        measured: dict[str, float | None] = {}
        for method, found in self.choices.items():
            measured |= {
                f"{method}_epochs": found.epochs,
                f"{method}_held_out_loss": found.loss,
                f"{method}_held_out_accuracy": found.accuracy,
                f"{method}_held_out_accuracy_of_chance": found.chance,
            }
        return measured | {
            "goal_planes_epochs": self.cutting.epochs,
            "goal_planes_held_out_loss": self.cutting.loss,
            "goal_planes_held_out_loss_of_one_gaussian": self.cutting.gaussian_loss,
        }


def learn_baselines(steps: Steps, settings: Settings, seed: int, watch: Callable[[str, int, int], Any]) -> Baselines:
    """Learn what `bc` and `qnet` use from the steps of the training trials (IV-B1).

    Args:
        steps: the steps.
        settings: of the baselines, and of the mixtures of planes.
        seed: of the training.
        watch: told the name of a network, how much of its training is done, and of how much.
    """
    choices, networks = {}, {}
    for method in (BC, QNET):
        choices[method] = cross_validate_choice(steps, method, settings.baselines, seed)
        watch(method, 1, 2)
        networks[method] = fit_choice(steps, method, settings.baselines, seed, choices[method])
        watch(method, 2, 2)
    cutting = cross_validate_goal_planes(steps, settings.baselines, settings.planes, seed)
    watch(GOAL_PLANES, 1, 2)
    planes = fit_goal_planes(steps, settings.baselines, settings.planes, seed, cutting)
    watch(GOAL_PLANES, 2, 2)
    return Baselines(networks[BC], networks[QNET], planes, choices, cutting)
