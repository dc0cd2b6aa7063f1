"""Training the plane head of the baselines on demonstrated cuts (IV-B1), as that of the grammar is trained (III-C).

In every epoch the fragment is seen under all four flips and each goal fragment under a flip of its own, the likelihood
of a plane is folded and z is jittered. Held-out trials choose the length of training; standard deviations have a floor.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.learning.plane_training import PlaneValidation, log_folded, one_gaussian, spread_out
from cutgrammar.learning.steps import Steps
from cutgrammar.nn.cross_validation import best_epoch, folds_of
from cutgrammar.nn.mixture import numbers_of
from cutgrammar.nn.mlp_training import descend, one_thread
from cutgrammar.nn.set_training import Appearances, SetParameters, initial_set, standard
from cutgrammar.perception.feature import scale_of
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import BaselineSettings, PlaneSettings

GOAL_PLANES = "goal_planes"
"""Its name in random streams and in what is measured."""


def fit_goal_planes(
    steps: Steps,
    settings: BaselineSettings,
    mixture: PlaneSettings,
    seed: int,
    validation: PlaneValidation | None = None,
) -> GoalPlaneNetwork:
    """Train the plane head on the steps of the training trials (IV-B1).

    Args:
        steps: the steps.
        settings: size and length of the training.
        mixture: number of components and floor of the mixture.
        seed: of the initial weights and the folds.
        validation: from `cross_validate_goal_planes` with the same arguments, where it was called before.
    """
    chosen = validation or cross_validate_goal_planes(steps, settings, mixture, seed)
    with one_thread():
        network, mean, deviation = _trained(steps, settings, mixture, seed, chosen.epochs)
        return GoalPlaneNetwork(mixture.n_components, mixture.min_sigma, network.finished(mean, deviation))


def cross_validate_goal_planes(
    steps: Steps, settings: BaselineSettings, mixture: PlaneSettings, seed: int
) -> PlaneValidation:
    """Choose the length of training on held-out trials; the arguments are those of `fit_goal_planes`."""
    folds = folds_of(steps.trials, settings.n_folds, stream(seed, GOAL_PLANES, "folds"))
    if not folds:
        return PlaneValidation(settings.max_plane_epochs)
    sums, gaussian, counted = np.zeros(settings.max_plane_epochs), 0.0, 0
    with one_thread():
        for fit, held in folds:
            curve: list[float] = []
            _trained(steps.of(fit), settings, mixture, seed, settings.max_plane_epochs, (steps.of(held), curve))
            sums += np.array(curve)
            y, held_y = (targets_of(steps.of(rows)).reshape(-1, 4) for rows in (fit, held))
            gaussian -= one_gaussian(y, mixture.min_sigma).log_folded(held_y).sum()
            counted += len(held_y)
    losses = tuple(float(value) for value in sums / counted)
    return PlaneValidation(best_epoch(losses), losses, float(gaussian / counted))


def targets_of(steps: Steps) -> Floats:
    """(4, m, 4) the planes (n, d / scale) of m steps, under each flip of the fragment."""
    rows = []
    for flip in FLIPS:
        planes = [plane.transformed(flip) for plane in steps.planes_C]
        scales = [scale_of(z[0]) for z in steps.z[steps.cut]]
        rows.append([np.append(p.normal, p.offset / scale) for p, scale in zip(planes, scales, strict=True)])
    return np.array(rows)


def _trained(
    steps: Steps,
    settings: BaselineSettings,
    mixture: PlaneSettings,
    seed: int,
    epochs: int,
    watched: tuple[Steps, list[float]] | None = None,
) -> tuple[SetParameters, Floats, Floats]:
    """The network for standardised z, with the mean and deviation of these; `watched` collects summed losses."""
    mean, deviation = standard(steps.z, np.flatnonzero(steps.now.any(axis=0) | steps.goal.any(axis=0)))
    rng, m = stream(seed, GOAL_PLANES, "weights"), mixture.n_components
    members = float(steps.goal.sum(axis=1).mean())
    network = initial_set(len(mean), settings.hidden_size, settings.embedding_size, 1, numbers_of(m, 4), members, rng)
    y = targets_of(steps)
    with torch.no_grad():  # components start about planes that were demonstrated, and wide
        chosen = spread_out(y.reshape(-1, 4), m, rng)
        network.head[-1][1][m : 5 * m] = torch.tensor(chosen.ravel(), dtype=torch.float32)
        network.head[-1][0].mul_(0.1)

    generator = torch.Generator().manual_seed(torch_seed(seed, GOAL_PLANES, "jitter"))
    z = torch.tensor((steps.z - mean) / deviation, dtype=torch.float32)
    seen = Appearances(z, settings.plane_jitter, generator)

    def losses(now: torch.Tensor, goal: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """(r,) for fragments (r, 17), embeddings of their goals (r, e), and planes (r, 4)."""
        return -log_folded(network(now, goal), targets, m, mixture.min_sigma)

    cut, goals, targets = _tensors(steps, y)

    def loss() -> torch.Tensor:
        wanted = network.embed(seen.drawn(), goals)
        noise = seen.jitter * torch.randn((len(FLIPS), len(cut), z.shape[2]), generator=generator)
        now = (z[cut].transpose(0, 1) + noise).reshape(-1, z.shape[2])
        return losses(now, wanted.repeat(len(FLIPS), 1), targets).mean()

    watch: Callable[[], Any] | None = None
    if watched is not None:
        held_cut, held_goals, held_targets = _tensors(watched[0], targets_of(watched[0]))
        curve = watched[1]

        def watch() -> None:
            wanted = network.embed(z[:, 0], held_goals)
            now = z[held_cut].transpose(0, 1).reshape(-1, z.shape[2])
            curve.append(float(losses(now, wanted.repeat(len(FLIPS), 1), held_targets).sum()))

    descend(network.layers, loss, epochs, settings.learning_rate, settings.weight_decay, watch)
    return network, mean, deviation


def _tensors(steps: Steps, targets: Floats) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Fragments cut (m,), members of the goals (m, n), and planes (4 m, 4): all steps under the first flip first."""
    return (
        torch.tensor(steps.cut),
        torch.tensor(steps.goal, dtype=torch.float32),
        torch.tensor(targets.reshape(-1, 4), dtype=torch.float32),
    )
