"""Training what the baselines choose a fragment by (IV-B1): the policy of BC and the Q function of QNet.

Both see (z_i, s, s_g): the shape feature of a fragment and the embeddings of the current configuration and of the goal.

BC is fitted to what was cut: the loss is the cross entropy of the fragment that was cut among those that were there.

QNet learns offline from the logged transitions. The reward is 1 for the cut that reaches the goal and 0 for any other,
so a step is worth 1, or `discount` times the greatest value of a fragment of the next configuration as the target
network has it. Since all demonstrations are good ones, a large-margin loss (Hester et al. 2018) holds the value of any
other fragment below that of the one that was cut.

How long to train is chosen on held-out trials. For BC by the same loss; for QNet by that with what the demonstration
really earned from the step on in place of the temporal difference, for a network that knows nothing yet is consistent
with itself too.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from cutgrammar.geometry.arrays import Floats
from cutgrammar.learning.steps import Steps
from cutgrammar.nn.cross_validation import best_epoch, folds_of
from cutgrammar.nn.mlp_training import descend, one_thread
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.nn.set_training import Appearances, SetParameters, initial_set, standard
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import BaselineSettings

BC, QNET = "bc", "qnet"
"""The two, as methods and in random streams."""


@dataclass(frozen=True)
class ChoiceValidation:
    """What cross-validation chose and found.

    Attributes:
        epochs: length of the training.
        losses: held-out loss after each epoch, empty where nothing could be held out.
        accuracy: share of held-out steps with a choice in which the fragment that was cut has the greatest output after
            the epochs chosen; None likewise, or where there was never a choice.
        chance: what drawing a fragment of those steps at random would reach, None likewise.
    """

    epochs: int
    losses: tuple[float, ...] = ()
    accuracy: float | None = None
    chance: float | None = None

    @property
    def loss(self) -> float | None:
        """The loss after the epochs chosen."""
        return self.losses[self.epochs - 1] if self.losses else None


@dataclass(frozen=True, eq=False)
class Batch:
    """Steps as tensors.

    Attributes:
        now, goal: (m, n) as numbers.
        step, fragment: (r,) the pairs of a step and a fragment that was there.
        cut, after: (m,).
    """

    now: torch.Tensor
    goal: torch.Tensor
    step: torch.Tensor
    fragment: torch.Tensor
    cut: torch.Tensor
    after: torch.Tensor

    def worth(self, outputs: torch.Tensor, discount: float) -> torch.Tensor:
        """(m,) what each step is worth if the values `outputs` (m, n) of the next step hold."""
        later = outputs.max(dim=1).values[self.after]
        return torch.where(self.after < 0, torch.ones(()), discount * later)

    def earned(self, discount: float) -> torch.Tensor:
        """(m,) the discounted reward that the demonstration earned from each step on."""
        earned = torch.ones(len(self.after))
        for step in reversed(range(len(earned))):
            if self.after[step] >= 0:
                earned[step] = discount * earned[self.after[step]]
        return earned

    @staticmethod
    def of(steps: Steps) -> "Batch":
        """All of `steps`."""
        step, fragment = np.nonzero(steps.now)
        now, goal = (torch.tensor(sets, dtype=torch.float32) for sets in (steps.now, steps.goal))
        return Batch(now, goal, *(torch.tensor(a) for a in (step, fragment, steps.cut, steps.after)))

    def outputs(self, network: SetParameters, z: torch.Tensor) -> torch.Tensor:
        """(m, n) the output for every fragment that was there, minus infinity for those that were not."""
        s, s_g = network.embed(z, self.now), network.embed(z, self.goal)
        told = network(z[self.fragment], s[self.step], s_g[self.step])[:, 0]
        return torch.full(self.now.shape, -torch.inf).index_put((self.step, self.fragment), told)


Loss = Callable[[Batch, torch.Tensor, torch.Tensor], torch.Tensor]
"""(steps, outputs (m, n) of the network, what each step is worth (m,)) -> loss (m,) of each step."""


def fit_choice(
    steps: Steps, method: str, settings: BaselineSettings, seed: int, validation: ChoiceValidation | None = None
) -> SetNetwork:
    """Train the policy of BC or the Q function of QNet on the steps of the training trials (IV-B1).

    Args:
        steps: the steps.
        method: `BC` or `QNET`.
        settings: size and length of the training.
        seed: of the initial weights and the folds.
        validation: from `cross_validate_choice` with the same arguments, where it was called before.
    """
    chosen = validation or cross_validate_choice(steps, method, settings, seed)
    with one_thread():
        network, mean, deviation = _trained(steps, method, settings, seed, chosen.epochs)
        return network.finished(mean, deviation)


def cross_validate_choice(steps: Steps, method: str, settings: BaselineSettings, seed: int) -> ChoiceValidation:
    """Choose the length of training on held-out trials; the arguments are those of `fit_choice`."""
    folds = folds_of(steps.trials, settings.n_folds, stream(seed, method, "folds"))
    if not folds:
        return ChoiceValidation(settings.max_epochs)
    sums, right = np.zeros(settings.max_epochs), np.zeros(settings.max_epochs)
    with one_thread():
        for fit, held in folds:
            curve: list[tuple[float, float]] = []
            _trained(steps.of(fit), method, settings, seed, settings.max_epochs, (steps.of(held), curve))
            losses, hits = np.array(curve).T
            sums, right = sums + losses, right + hits
    epochs = best_epoch(tuple(sums))
    among = steps.now.sum(axis=1)
    open_steps = int((among > 1).sum())
    return ChoiceValidation(
        epochs,
        tuple(float(value) for value in sums / len(steps)),
        float(right[epochs - 1]) / open_steps if open_steps else None,
        float((1.0 / among[among > 1]).mean()) if open_steps else None,
    )


def cloning_loss(batch: Batch, scores: torch.Tensor, worth: torch.Tensor) -> torch.Tensor:
    """(m,) cross entropy of the fragment that was cut [nats]; what a step is worth plays no part."""
    del worth
    return torch.nn.functional.cross_entropy(scores, batch.cut, reduction="none")


def value_loss(settings: BaselineSettings) -> Loss:
    """The loss of QNet: the squared difference to what a step is worth, and the large margin."""

    def loss(batch: Batch, values: torch.Tensor, worth: torch.Tensor) -> torch.Tensor:
        rows = torch.arange(len(batch.cut))
        logged = values[rows, batch.cut]
        margins = torch.full(values.shape, settings.margin).index_put((rows, batch.cut), torch.zeros(()))
        return (logged - worth) ** 2 + settings.margin_weight * ((values + margins).max(dim=1).values - logged)

    return loss


def _trained(
    steps: Steps,
    method: str,
    settings: BaselineSettings,
    seed: int,
    epochs: int,
    watched: tuple[Steps, list[tuple[float, float]]] | None = None,
) -> tuple[SetParameters, Floats, Floats]:
    """The network for standardised z, with the mean and deviation of these; `watched` collects losses and hits."""
    mean, deviation = standard(steps.z, np.flatnonzero(steps.now.any(axis=0) | steps.goal.any(axis=0)))
    members = float(steps.goal.sum(axis=1).mean())
    rng = stream(seed, method, "weights")
    network = initial_set(len(mean), settings.hidden_size, settings.embedding_size, 2, 1, members, rng)
    with torch.no_grad():
        network.head[-1][0].mul_(0.1)  # at first all fragments are about alike
    generator = torch.Generator().manual_seed(torch_seed(seed, method, "jitter"))
    seen = Appearances(torch.tensor((steps.z - mean) / deviation, dtype=torch.float32), settings.jitter, generator)
    of_step = cloning_loss if method == BC else value_loss(settings)
    batch, epoch, target = Batch.of(steps), 0, network.copied()
    worth = batch.earned(settings.discount)

    def loss() -> torch.Tensor:
        nonlocal epoch, target, worth
        z = seen.drawn()
        if method == QNET:
            if epoch % settings.target_update_epochs == 0:
                target = network.copied()
            worth, epoch = batch.worth(batch.outputs(target, z), settings.discount), epoch + 1
        return of_step(batch, batch.outputs(network, z), worth).mean()

    watch: Callable[[], Any] | None = None
    if watched is not None:
        held, curve = Batch.of(watched[0]), watched[1]
        choice, earned = held.now.sum(dim=1) > 1, held.earned(settings.discount)

        def watch() -> None:
            outputs = [held.outputs(network, z) for z in seen.held_out()]
            losses = [float(of_step(held, told, earned).sum()) for told in outputs]
            hits = [float(((told.argmax(dim=1) == held.cut) & choice).sum()) for told in outputs]
            curve.append((float(np.mean(losses)), float(np.mean(hits))))

    descend(network.layers, loss, epochs, settings.learning_rate, settings.weight_decay, watch)
    return network, mean, deviation
