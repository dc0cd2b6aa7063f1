"""Training the plane head of the baselines on demonstrated cuts (IV-B1), as that of the grammar is trained (III-C).

In every epoch the fragment is seen under all four flips and each goal fragment under a flip of its own, the mixture is
folded, z is jittered, and standard deviations have a floor.
"""

import numpy as np
import torch

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.learning.plane_training import centre_on_planes, log_folded
from cutgrammar.learning.plane_validation import PlaneValidation, validate_planes
from cutgrammar.learning.steps import Steps
from cutgrammar.nn.cross_validation import Progress, fit_and_validate
from cutgrammar.nn.mixture import Mixture, numbers_of
from cutgrammar.nn.mlp_training import batches, deterministic, fit
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.nn.set_training import AugmentedFeatures, Sets, initialise_set_network, mean_and_deviation
from cutgrammar.perception.feature import scale_of
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import BaselineSettings, PlaneSettings

GOAL_PLANES = "goal_planes"
"""The name of the network in random streams and in metrics."""


def fit_goal_planes(
    steps: Steps,
    settings: BaselineSettings,
    mixture: PlaneSettings,
    seed: int,
    progress: Progress | None = None,
) -> tuple[GoalPlaneNetwork, PlaneValidation]:
    """Train the plane head on the steps of the training trials (IV-B1).

    Args:
        steps: the steps.
        settings: size of the network and of the training.
        mixture: number of components and floor of the mixture.
        seed: of the initial weights and the folds.
        progress: see `fit_and_validate`.
    """

    def network(layers: SetNetwork) -> GoalPlaneNetwork:
        return GoalPlaneNetwork(mixture.n_components, mixture.min_sigma, layers)

    def train(rows: Ints, held: Ints) -> tuple[GoalPlaneNetwork, list[float]]:
        layers, losses = _train(steps.of(rows), settings, mixture, seed, steps.of(held))
        return network(layers), losses

    def mixture_of_step(one: GoalPlaneNetwork, row: int) -> Mixture:
        return one.mixture(steps.z[steps.cut[row], 0], steps.z[steps.goal[row], 0])

    with deterministic():
        rng = stream(seed, GOAL_PLANES, "folds")
        found = fit_and_validate(steps.trials, settings.n_folds, rng, train, progress)
    planes = targets_of(steps).transpose(1, 0, 2)
    return found.fitted, validate_planes(found, mixture_of_step, planes, steps.of_whole_objects, mixture)


def targets_of(steps: Steps) -> Floats:
    """(4, m, 4) the planes (n, d / scale) of m steps, under each flip of the fragment."""
    rows = []
    for flip in FLIPS:
        planes = [plane.transformed(flip) for plane in steps.planes_C]
        scales = [scale_of(z[0]) for z in steps.z[steps.cut]]
        rows.append([np.append(p.normal, p.offset / scale) for p, scale in zip(planes, scales, strict=True)])
    return np.array(rows).reshape(len(FLIPS), len(steps), 4)


def _train(
    steps: Steps,
    settings: BaselineSettings,
    mixture: PlaneSettings,
    seed: int,
    held_out: Steps,
) -> tuple[SetNetwork, list[float]]:
    """The network, and the summed loss of the `held_out` steps after each epoch [nats]."""
    mean, deviation = mean_and_deviation(steps.z, steps.fragments)
    rng, m = stream(seed, GOAL_PLANES, "weights"), mixture.n_components
    sizes = len(mean), settings.hidden_size, settings.embedding_size
    network = initialise_set_network(*sizes, 1, numbers_of(m, 4), steps.mean_goal_size, rng)
    y = targets_of(steps)
    centre_on_planes(network.head, y.reshape(-1, 4), m, rng)
    generator = torch.Generator().manual_seed(torch_seed(seed, GOAL_PLANES, "jitter"))
    z = torch.tensor((steps.z - mean) / deviation, dtype=torch.float32)
    augmented = AugmentedFeatures(z, settings.plane_jitter, generator)

    def losses(z_cut: torch.Tensor, goals: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """(4 r,) for fragments (4, r, 17) under each flip, embeddings of their goals (r, e), and planes (4, r, 4)."""
        outputs = network(z_cut, goals.expand(len(FLIPS), -1, -1))
        return -log_folded(outputs.flatten(0, 1), targets.flatten(0, 1), m, mixture.min_sigma)

    cut, goals, targets = _tensors(steps, y)
    rows_of_step = batches(len(cut), settings.batch_size, generator)

    def loss() -> torch.Tensor:
        rows = rows_of_step()
        embedded = network.embed(augmented.sample(), goals.at(rows))
        z_cut = z[cut[rows]].transpose(0, 1)
        noise = augmented.jitter * torch.randn(z_cut.shape, generator=generator)
        return losses(z_cut + noise, embedded, targets[:, rows]).mean()

    held_cut, held_goals, held_targets = _tensors(held_out, targets_of(held_out))

    def validate() -> float:
        embedded = network.embed(z[:, 0], held_goals)
        return float(losses(z[held_cut].transpose(0, 1), embedded, held_targets).sum())

    measured = fit(network.layers, loss, settings.plane_epochs, settings.learning_rate, settings.weight_decay, validate)
    return network.to_network(mean, deviation), measured


def _tensors(steps: Steps, targets: Floats) -> tuple[torch.Tensor, Sets, torch.Tensor]:
    """Fragments cut (m,), the m goals, and planes (4, m, 4) of all steps."""
    return torch.tensor(steps.cut), Sets.of(steps.goal), torch.tensor(targets, dtype=torch.float32)
