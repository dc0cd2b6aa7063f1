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
from cutgrammar.nn.cross_validation import Progress, fit_and_validate
from cutgrammar.nn.mlp_training import batches, deterministic, fit
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.nn.set_training import (
    AugmentedFeatures,
    Sets,
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
        now, goal: the current fragments and those of the goal, of each of m steps.
        cut: (m,) the place of the fragment that was cut among those of `now`.
        after: (m,) see `Steps`.
    """

    now: Sets
    goal: Sets
    cut: torch.Tensor
    after: torch.Tensor

    @staticmethod
    def of(steps: Steps) -> "Batch":
        """All of `steps`."""
        now, cut = Sets.of(steps.now), torch.tensor(steps.cut)
        place = ((now.members == cut[:, None]) & now.present).int().argmax(dim=1)
        return Batch(now, Sets.of(steps.goal), place, torch.tensor(steps.after))

    def at(self, rows: torch.Tensor) -> "Batch":
        """The steps with these numbers; `after` keeps the numbers among all."""
        return Batch(self.now.at(rows), self.goal.at(rows), self.cut[rows], self.after[rows])

    def bootstrapped_targets(self, values: torch.Tensor, discount: float) -> torch.Tensor:
        """(m,) target value of each step, if the `values` (m, w) of the fragments in its next step are right."""
        return torch.where(self.after < 0, torch.ones(()), discount * values.max(dim=1).values)

    def returns(self, discount: float) -> torch.Tensor:
        """(m,) the discounted reward that the demonstration earned from each step on, for all steps of whole trials."""
        returns = torch.ones(len(self.after))
        for step in reversed(range(len(returns))):
            if self.after[step] >= 0:
                returns[step] = discount * returns[self.after[step]]
        return returns

    def outputs(self, network: TrainableSetNetwork, z: torch.Tensor) -> torch.Tensor:
        """(m, w) the output for every current fragment, minus infinity at places without one."""
        width = self.now.members.shape[1]
        sets = [network.embed(z, s)[:, None].expand(-1, width, -1) for s in (self.now, self.goal)]
        return network(z[self.now.members], *sets)[..., 0].masked_fill(~self.now.present, -torch.inf)


Loss = Callable[[Batch, torch.Tensor, torch.Tensor], torch.Tensor]
"""(steps, outputs (m, w) of the network, target values (m,)) -> loss (m,) of each step."""


def fit_choice(
    steps: Steps,
    method: str,
    settings: BaselineSettings,
    seed: int,
    progress: Progress | None = None,
) -> tuple[SetNetwork, ChoiceValidation]:
    """Train the policy of BC or the Q function of QNet (IV-B1).

    Args:
        steps: the steps of the training trials.
        method: `BC` or `QNET`.
        settings: size of the network and of the training.
        seed: of the initial weights and the folds.
        progress: see `fit_and_validate`.
    """

    def train(rows: Ints, held: Ints) -> tuple[SetNetwork, list[tuple[float, float]]]:
        return _train(steps.of(rows), method, settings, seed, steps.of(held))

    with deterministic():
        rng = stream(seed, method, "folds")
        found = fit_and_validate(steps.trials, settings.n_folds, rng, train, progress)
    if not found.folds:
        return found.fitted, ChoiceValidation()
    n_current = np.array([len(now) for now in steps.now])
    n_choices = int((n_current > 1).sum())
    return found.fitted, ChoiceValidation(
        tuple(float(value) for value in found.sums[:, 0] / len(steps)),
        float(found.sums[-1, 1]) / n_choices if n_choices else None,
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
    held_out: Steps,
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
    rows_of_step = batches(len(steps), settings.batch_size, generator)

    def loss() -> torch.Tensor:
        nonlocal epoch, target_network
        z, rows = augmented.sample(), rows_of_step()
        some, wanted = batch.at(rows), targets[rows]
        if method == QNET:
            if epoch % settings.target_update_epochs == 0:
                target_network = network.frozen_copy()
            next_values = batch.at(some.after.clamp(min=0)).outputs(target_network, z)
            wanted, epoch = some.bootstrapped_targets(next_values, settings.discount), epoch + 1
        return loss_of_steps(some, some.outputs(network, z), wanted).mean()

    held = Batch.of(held_out)
    has_choice, returns = held.now.present.sum(dim=1) > 1, held.returns(settings.discount)

    def validate() -> tuple[float, float]:
        outputs = [held.outputs(network, z) for z in augmented.flips()]
        losses = [float(loss_of_steps(held, one, returns).sum()) for one in outputs]
        hits = [float(((one.argmax(dim=1) == held.cut) & has_choice).sum()) for one in outputs]
        return float(np.mean(losses)), float(np.mean(hits))

    measured = fit(network.layers, loss, settings.epochs, settings.learning_rate, settings.weight_decay, validate)
    return network.to_network(mean, deviation), measured
