"""Training the mixture density network for cutting planes on demonstrated cuts (III-C).

The signs of the canonical frame are noise for many fragments, so the network is trained on all four flips of a
fragment. (n, d) is the same plane as (-n, -d), so the likelihood of a plane is that of either: the mixture is folded. A
hundred cuts are few, so z is jittered anew in every epoch, the length of training is chosen on held-out trials, and a
floor keeps the Gaussians from closing in on single demonstrations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from cutgrammar.cutting.planes import PlaneNetwork, inputs_of
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.production import Production
from cutgrammar.nn.cross_validation import best_epoch, folds_of
from cutgrammar.nn.mixture import Mixture, numbers_of, parts_of
from cutgrammar.nn.mlp import deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Parameters, descend, finished, forward, initial, one_thread
from cutgrammar.perception.feature import scale_of
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import PlaneSettings


@dataclass(frozen=True, eq=False)
class DemonstratedPlane:
    """What the network learns from: one cut of a training trial.

    Attributes:
        production: what it did, in fragment types.
        z: (4, 17) shape feature of the fragment that was cut, under each of `FLIPS`.
        plane_C: its plane in the canonical frame of the fragment [m].
        group: what is held out together, e.g. the number of the trial.
    """

    production: Production
    z: Floats
    plane_C: Plane
    group: int


@dataclass(frozen=True)
class PlaneValidation:
    """What cross-validation chose and found.

    Attributes:
        epochs: length of the training.
        losses: held-out negative log density after each epoch [nats], empty where nothing could be held out.
        gaussian_loss: the same for one Gaussian that looks at nothing, None likewise.
    """

    epochs: int
    losses: tuple[float, ...] = ()
    gaussian_loss: float | None = None

    @property
    def loss(self) -> float | None:
        """The loss after the epochs chosen."""
        return self.losses[self.epochs - 1] if self.losses else None


def fit_planes(
    cuts: Sequence[DemonstratedPlane],
    k: int,
    settings: PlaneSettings,
    seed: int,
    validation: PlaneValidation | None = None,
) -> PlaneNetwork:
    """Train the mixture density network on the training cuts (III-C).

    Args:
        cuts: the cuts.
        k: number of fragment types.
        settings: size and length of the training.
        seed: of the initial weights and the folds.
        validation: from `cross_validate_planes` with the same arguments, where it was called before.

    Raises:
        ValueError: no cuts.
    """
    if not cuts:
        raise ValueError("a network for cutting planes needs at least one cut")
    chosen = validation or cross_validate_planes(cuts, k, settings, seed)
    with one_thread():
        layers, mean, deviation = _trained(*_rows(cuts, k), k, settings, seed, chosen.epochs)
        network = with_standardised_inputs(finished(layers), mean, deviation)
    return PlaneNetwork(k, settings.n_components, settings.min_sigma, network)


def cross_validate_planes(
    cuts: Sequence[DemonstratedPlane], k: int, settings: PlaneSettings, seed: int
) -> PlaneValidation:
    """Choose the length of training on held-out trials; the arguments are those of `fit_planes`."""
    folds = folds_of(np.array([cut.group for cut in cuts]), settings.n_folds, stream(seed, "planes", "folds"))
    if not folds:
        return PlaneValidation(settings.max_epochs)
    sums, gaussian, counted = np.zeros(settings.max_epochs), 0.0, 0
    with one_thread():
        for fit, held in folds:
            x, y = _rows([cuts[i] for i in fit], k)
            held_x, held_y = _rows([cuts[i] for i in held], k)
            curve: list[float] = []
            _trained(x, y, k, settings, seed, settings.max_epochs, (held_x, held_y, curve))
            sums += np.array(curve)
            gaussian -= one_gaussian(y, settings.min_sigma).log_folded(held_y).sum()
            counted += len(held_y)
    losses = tuple(float(value) for value in sums / counted)
    return PlaneValidation(best_epoch(losses), losses, float(gaussian / counted))


def one_gaussian(planes: Floats, min_sigma: float) -> Mixture:
    """The Gaussian that fits planes (n, 4) and their opposites best, whatever was cut."""
    return Mixture(np.ones(1), np.zeros((1, 4)), np.maximum(np.sqrt((planes**2).mean(axis=0)), min_sigma)[None])


def log_densities(raw: torch.Tensor, points: torch.Tensor, components: int, min_sigma: float) -> torch.Tensor:
    """(n,) log density of points (n, d) under the mixtures that raw numbers (n, numbers_of(m, d)) stand for."""
    logits, means, widths = parts_of(raw, components)
    sigmas = min_sigma + torch.nn.functional.softplus(widths)
    off = (points[:, None, :] - means) / sigmas
    parts = -0.5 * (off**2).sum(dim=2) - torch.log(sigmas * float(np.sqrt(2.0 * np.pi))).sum(dim=2)
    return torch.logsumexp(parts + torch.log_softmax(logits, dim=1), dim=1)


def log_folded(raw: torch.Tensor, planes: torch.Tensor, components: int, min_sigma: float) -> torch.Tensor:
    """(n,) the same for planes (n, 4), of which (n, d) and (-n, -d) are one."""
    signs = (log_densities(raw, sign * planes, components, min_sigma) for sign in (1.0, -1.0))
    return torch.logaddexp(*signs)


def spread_out(planes: Floats, count: int, rng: np.random.Generator) -> Floats:
    """(count, 4) of the planes (n, 4), drawn far from one another as k-means++ draws its means."""
    chosen = [planes[rng.integers(len(planes))]]
    while len(chosen) < count:
        far = np.min([((sign * planes - one) ** 2).sum(axis=1) for one in chosen for sign in (1.0, -1.0)], axis=0)
        far += 1e-9
        chosen.append(planes[rng.choice(len(planes), p=far / far.sum())])
    return np.array(chosen)


def _rows(cuts: Sequence[DemonstratedPlane], k: int) -> tuple[Floats, Floats]:
    """Inputs (4 n, 2 k + 17) and planes (4 n, 4), d divided by the scale: under each of the four flips."""
    x, y = [], []
    for cut in cuts:
        scale = scale_of(cut.z[0])
        for z, flip in zip(cut.z, FLIPS, strict=True):
            plane = cut.plane_C.transformed(flip)
            x.append(inputs_of(cut.production, z, k))
            y.append(np.append(plane.normal, plane.offset / scale))
    return np.array(x), np.array(y)


def _trained(
    x: Floats,
    y: Floats,
    k: int,
    settings: PlaneSettings,
    seed: int,
    epochs: int,
    watched: tuple[Floats, Floats, list[float]] | None = None,
) -> tuple[Parameters, Floats, Floats]:
    """Layers for standardised inputs, with the mean and deviation of these; `watched` collects summed losses."""
    mean, deviation = np.zeros(x.shape[1]), np.ones(x.shape[1])
    mean[2 * k :], deviation[2 * k :] = x[:, 2 * k :].mean(axis=0), deviation_of(x[:, 2 * k :])
    rng = stream(seed, "planes", "weights")
    m = settings.n_components
    layers = initial((x.shape[1], settings.hidden_size, numbers_of(m, 4)), rng)
    with torch.no_grad():  # components start about planes that were demonstrated, and wide
        bias = layers[-1][1]
        bias[m : 5 * m] = torch.tensor(spread_out(y, m, rng).ravel(), dtype=torch.float32)
        layers[-1][0].mul_(0.1)

    def rows(inputs: Floats, planes: Floats) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.tensor((inputs - mean) / deviation, dtype=torch.float32), torch.tensor(planes, dtype=torch.float32)

    def losses(inputs: torch.Tensor, planes: torch.Tensor) -> torch.Tensor:
        return -log_folded(forward(layers, inputs), planes, m, settings.min_sigma)

    inputs, planes = rows(x, y)
    generator = torch.Generator().manual_seed(torch_seed(seed, "planes", "jitter"))
    spread = torch.tensor(np.where(np.arange(x.shape[1]) < 2 * k, 0.0, settings.jitter), dtype=torch.float32)

    def jittered() -> torch.Tensor:
        return losses(inputs + spread * torch.randn(inputs.shape, generator=generator), planes).mean()

    watch: Callable[[], Any] | None = None
    if watched is not None:
        held, curve = rows(*watched[:2]), watched[2]

        def watch() -> None:
            curve.append(float(losses(*held).sum()))

    descend(layers, jittered, epochs, settings.learning_rate, settings.weight_decay, watch)
    return layers, mean, deviation
