"""Training the networks by which the baselines choose a fragment (IV-B1): the policy of BC and the Q function of QNet.

Both take (z_i, s, s_g): the shape feature of a fragment and the embeddings of current configuration and goal.

BC imitates the demonstrated choices: the loss is the cross entropy of the fragment that was cut among the current ones.

QNet learns offline from the logged transitions. The reward is 1 for the cut that reaches the goal and 0 for any other,
so the target value of a step is 1, or `discount` times the greatest value that the target network gives a fragment of
the next configuration. Since only good demonstrations are logged, a large-margin loss (Hester et al. 2018) keeps the
value of any other fragment below that of the one that was cut.

The length of training is fixed. Held-out trials measure it: for BC by the same loss, for QNet with the demonstration's
discounted return as the target value, because the temporal difference of an untrained network is small too.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from cutgrammar.geometry.arrays import Ints
from cutgrammar.learning.steps import Steps
from cutgrammar.nn.cross_validation import cross_validate
from cutgrammar.nn.mlp_training import deterministic, fit
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.nn.set_training import (
    AugmentedFeatures,
    TrainableSetNetwork,
    initialise_set_network,
    mean_and_deviation,
)
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import BaselineSettings

BC, QNET = "bc", "qnet"
"""Names of the two baselines, also in random streams."""


@dataclass(frozen=True)
class ChoiceValidation:
    """What cross-validation measured.

    Attributes:
        losses: held-out loss after each epoch, empty where nothing could be held out.
        accuracy: of the held-out steps with more than one fragment, the share in which the fragment that was cut has
            the greatest output; None where nothing could be held out or there is no such step.
        chance: the accuracy of a uniformly drawn fragment; None likewise.
    """

    losses: tuple[float, ...] = ()
    accuracy: float | None = None
    chance: float | None = None

    @property
    def loss(self) -> float | None:
        """The held-out loss at the end of the training."""
        return self.losses[-1] if self.losses else None

    def metrics(self, method: str) -> dict[str, float | None]:
        """What was measured for `method`, by the name it has among a model's metrics."""
        return {
            f"{method}_held_out_loss": self.loss,
            f"{method}_held_out_accuracy": self.accuracy,
            f"{method}_held_out_accuracy_of_chance": self.chance,
        }


@dataclass(frozen=True, eq=False)
class Batch:
    """Steps as tensors.

    Attributes:
        now, goal: (m, n) 1 where a fragment is among the current fragments, or those of the goal, of a step; else 0.
        step, fragment: (r,) all pairs of a step and one of its current fragments.
        cut, after: (m,) see `Steps`.
    """

    now: torch.Tensor
    goal: torch.Tensor
    step: torch.Tensor
    fragment: torch.Tensor
    cut: torch.Tensor
    after: torch.Tensor

    @staticmethod
    def of(steps: Steps) -> "Batch":
        """All of `steps`."""
        step, fragment = np.nonzero(steps.now)
        now, goal = (torch.tensor(sets, dtype=torch.float32) for sets in (steps.now, steps.goal))
        return Batch(now, goal, *(torch.tensor(a) for a in (step, fragment, steps.cut, steps.after)))

    def bootstrapped_targets(self, values: torch.Tensor, discount: float) -> torch.Tensor:
        """(m,) target value of each step, if the `values` (m, n) of the fragments in the next step are right."""
        best_next = values.max(dim=1).values[self.after]
        return torch.where(self.after < 0, torch.ones(()), discount * best_next)

    def returns(self, discount: float) -> torch.Tensor:
        """(m,) the discounted reward that the demonstration earned from each step on."""
        returns = torch.ones(len(self.after))
        for step in reversed(range(len(returns))):
            if self.after[step] >= 0:
                returns[step] = discount * returns[self.after[step]]
        return returns

    def outputs(self, network: TrainableSetNetwork, z: torch.Tensor) -> torch.Tensor:
        """(m, n) the output for every current fragment, minus infinity for all others."""
        s, s_g = network.embed(z, self.now), network.embed(z, self.goal)
        outputs = network(z[self.fragment], s[self.step], s_g[self.step])[:, 0]
        return torch.full(self.now.shape, -torch.inf).index_put((self.step, self.fragment), outputs)


Loss = Callable[[Batch, torch.Tensor, torch.Tensor], torch.Tensor]
"""(steps, outputs (m, n) of the network, target values (m,)) -> loss (m,) of each step."""


def fit_choice(steps: Steps, method: str, settings: BaselineSettings, seed: int) -> tuple[SetNetwork, ChoiceValidation]:
    """Train the policy of BC or the Q function of QNet (IV-B1).

    Args:
        steps: the steps of the training trials.
        method: `BC` or `QNET`.
        settings: size of the network and of the training.
        seed: of the initial weights and the folds.
    """

    def train(rows: Ints, held: Ints) -> tuple[SetNetwork, list[tuple[float, float]]]:
        return _train(steps.of(rows), method, settings, seed, steps.of(held))

    with deterministic():
        held_out = cross_validate(steps.trials, settings.n_folds, stream(seed, method, "folds"), train)
        fitted, _ = _train(steps, method, settings, seed)
    if not held_out.folds:
        return fitted, ChoiceValidation()
    n_current = steps.now.sum(axis=1)
    n_choices = int((n_current > 1).sum())
    return fitted, ChoiceValidation(
        tuple(float(value) for value in held_out.sums[:, 0] / len(steps)),
        float(held_out.sums[-1, 1]) / n_choices if n_choices else None,
        float((1.0 / n_current[n_current > 1]).mean()) if n_choices else None,
    )


def cloning_loss(batch: Batch, scores: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """(m,) cross entropy of the fragment that was cut [nats]; target values are ignored."""
    del targets
    return torch.nn.functional.cross_entropy(scores, batch.cut, reduction="none")


def value_loss(settings: BaselineSettings) -> Loss:
    """The loss of QNet: the squared difference from the target value, and the large margin."""

    def loss(batch: Batch, values: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        rows = torch.arange(len(batch.cut))
        logged = values[rows, batch.cut]
        margins = torch.full(values.shape, settings.margin).index_put((rows, batch.cut), torch.zeros(()))
        return (logged - targets) ** 2 + settings.margin_weight * ((values + margins).max(dim=1).values - logged)

    return loss


def _train(
    steps: Steps,
    method: str,
    settings: BaselineSettings,
    seed: int,
    held_out: Steps | None = None,
) -> tuple[SetNetwork, list[tuple[float, float]]]:
    """The network, and after each epoch the summed loss of the `held_out` steps and the number of right choices.

    Both are means over the flips. A choice is right where the fragment that was cut has the greatest output.
    """
    mean, deviation = mean_and_deviation(steps.z, steps.fragments)
    rng = stream(seed, method, "weights")
    sizes = len(mean), settings.hidden_size, settings.embedding_size
    network = initialise_set_network(*sizes, 2, 1, steps.mean_goal_size, rng)
    with torch.no_grad():
        network.head[-1][0].mul_(0.1)  # at first all fragments have similar outputs
    generator = torch.Generator().manual_seed(torch_seed(seed, method, "jitter"))
    z = torch.tensor((steps.z - mean) / deviation, dtype=torch.float32)
    augmented = AugmentedFeatures(z, settings.jitter, generator)
    loss_of_steps = cloning_loss if method == BC else value_loss(settings)
    batch, epoch, target_network = Batch.of(steps), 0, network.frozen_copy()
    targets = batch.returns(settings.discount)

    def loss() -> torch.Tensor:
        nonlocal epoch, target_network, targets
        z = augmented.sample()
        if method == QNET:
            if epoch % settings.target_update_epochs == 0:
                target_network = network.frozen_copy()
            targets, epoch = batch.bootstrapped_targets(batch.outputs(target_network, z), settings.discount), epoch + 1
        return loss_of_steps(batch, batch.outputs(network, z), targets).mean()

    validate: Callable[[], tuple[float, float]] | None = None
    if held_out is not None:
        held = Batch.of(held_out)
        has_choice, returns = held.now.sum(dim=1) > 1, held.returns(settings.discount)

        def validate() -> tuple[float, float]:
            outputs = [held.outputs(network, z) for z in augmented.flips()]
            losses = [float(loss_of_steps(held, one, returns).sum()) for one in outputs]
            hits = [float(((one.argmax(dim=1) == held.cut) & has_choice).sum()) for one in outputs]
            return float(np.mean(losses)), float(np.mean(hits))

    measured = fit(network.layers, loss, settings.epochs, settings.learning_rate, settings.weight_decay, validate)
    return network.to_network(mean, deviation), measured
