"""Training the mixture density network for cutting planes on demonstrated cuts (III-C).

The signs of the canonical frame are noise for many fragments, so the network is trained on all four flips of a
fragment. (n, d) and (-n, -d) are the same plane, so the mixture is folded: the density of a plane is the sum over both.
A hundred cuts are few: z is jittered anew in every epoch, held-out trials choose the length of training, and a floor of
the standard deviations keeps the Gaussians from collapsing onto single demonstrations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cutgrammar.cutting.planes import PlaneNetwork, inputs_of
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.production import Production
from cutgrammar.nn.cross_validation import Fold, best_epoch, grouped_folds, held_out_sums
from cutgrammar.nn.mixture import Mixture, numbers_of, parts_of
from cutgrammar.nn.mlp import MLP, deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Layers, deterministic, fit, forward, initialise, to_mlp
from cutgrammar.perception.feature import scale_of
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import PlaneSettings


@dataclass(frozen=True, eq=False)
class DemonstratedPlane:
    """One cut of a training trial, from which the network learns.

    Attributes:
        production: the cut in fragment types.
        z: (4, 17) shape feature of the fragment that was cut, under each of `FLIPS`.
        plane_C: its plane in the canonical frame of the fragment [m].
        group: cuts of one group, e.g. of one trial, are held out together.
    """

    production: Production
    z: Floats
    plane_C: Plane
    group: int


@dataclass(frozen=True)
class PlaneValidation:
    """What cross-validation chose and measured.

    Attributes:
        epochs: length of the training.
        losses: held-out negative log density after each epoch [nats], empty where nothing could be held out.
        gaussian_loss: the same for one Gaussian without inputs; None where nothing could be held out.
    """

    epochs: int
    losses: tuple[float, ...] = ()
    gaussian_loss: float | None = None

    @property
    def loss(self) -> float | None:
        """The held-out loss after the chosen number of epochs."""
        return self.losses[self.epochs - 1] if self.losses else None

    def metrics(self, name: str) -> dict[str, float | None]:
        """What was measured for the network called `name`, by the name it has among a model's metrics."""
        return {
            f"{name}_epochs": self.epochs,
            f"{name}_held_out_loss": self.loss,
            f"{name}_held_out_loss_of_one_gaussian": self.gaussian_loss,
        }


def fit_planes(
    cuts: Sequence[DemonstratedPlane], k: int, settings: PlaneSettings, seed: int
) -> tuple[PlaneNetwork, PlaneValidation]:
    """Train the mixture density network on the training cuts, as long as held-out trials show to be best (III-C).

    Args:
        cuts: the cuts.
        k: number of fragment types.
        settings: size of the network and of the training.
        seed: of the initial weights and the folds.

    Raises:
        ValueError: no cuts.
    """
    if not cuts:
        raise ValueError("a network for cutting planes needs at least one cut")
    folds = grouped_folds(np.array([cut.group for cut in cuts]), settings.n_folds, stream(seed, "planes", "folds"))

    def pairs(rows: Ints) -> tuple[Floats, Floats]:
        return _inputs_and_planes([cuts[i] for i in rows], k)

    def held_out_losses(rows: Ints, held: Ints) -> list[float]:
        return _train(*pairs(rows), k, settings, seed, settings.max_epochs, pairs(held))[1]

    with deterministic():
        found = validate_mixture(
            folds, held_out_losses, lambda rows: pairs(rows)[1], settings.max_epochs, settings.min_sigma
        )
        layers, _ = _train(*_inputs_and_planes(cuts, k), k, settings, seed, found.epochs)
    return PlaneNetwork(k, settings.n_components, settings.min_sigma, layers), found


def validate_mixture(
    folds: Sequence[Fold],
    train: Callable[[Ints, Ints], Sequence[float]],
    planes_of: Callable[[Ints], Floats],
    max_epochs: int,
    min_sigma: float,
) -> PlaneValidation:
    """Choose the length of training of a mixture over planes.

    Args:
        folds: rows to train on and rows held out.
        train: see `held_out_sums`; it measures the summed negative log density of the held-out planes [nats].
        planes_of: rows -> their planes (n, 4).
        max_epochs: length of the training where nothing can be held out.
        min_sigma: floor of the standard deviations.
    """
    if not folds:
        return PlaneValidation(max_epochs)
    sums = held_out_sums(folds, train)
    gaussian, n_planes = 0.0, 0
    for rows, held in folds:
        planes = planes_of(held)
        gaussian -= one_gaussian(planes_of(rows), min_sigma).log_folded(planes).sum()
        n_planes += len(planes)
    losses = tuple(float(value) for value in sums / n_planes)
    return PlaneValidation(best_epoch(losses), losses, float(gaussian / n_planes))


def one_gaussian(planes: Floats, min_sigma: float) -> Mixture:
    """The Gaussian that fits the planes (n, 4) and their opposites best, without any input."""
    return Mixture(np.ones(1), np.zeros((1, 4)), np.maximum(np.sqrt((planes**2).mean(axis=0)), min_sigma)[None])


def log_densities(raw: torch.Tensor, points: torch.Tensor, components: int, min_sigma: float) -> torch.Tensor:
    """(n,) log density of points (n, d) under the mixtures that outputs (n, numbers_of(m, d)) stand for."""
    logits, means, widths = parts_of(raw, components)
    sigmas = min_sigma + torch.nn.functional.softplus(widths)
    off = (points[:, None, :] - means) / sigmas
    parts = -0.5 * (off**2).sum(dim=2) - torch.log(sigmas * float(np.sqrt(2.0 * np.pi))).sum(dim=2)
    return torch.logsumexp(parts + torch.log_softmax(logits, dim=1), dim=1)


def log_folded(raw: torch.Tensor, planes: torch.Tensor, components: int, min_sigma: float) -> torch.Tensor:
    """(n,) log density of planes (n, 4), with (n, d) and (-n, -d) the same plane."""
    signs = (log_densities(raw, sign * planes, components, min_sigma) for sign in (1.0, -1.0))
    return torch.logaddexp(*signs)


def spread_out(planes: Floats, count: int, rng: np.random.Generator) -> Floats:
    """(count, 4) of the planes (n, 4), drawn far from one another as k-means++ draws its means."""
    chosen = [planes[rng.integers(len(planes))]]
    while len(chosen) < count:
        squares = np.min([((sign * planes - one) ** 2).sum(axis=1) for one in chosen for sign in (1.0, -1.0)], axis=0)
        squares += 1e-9
        chosen.append(planes[rng.choice(len(planes), p=squares / squares.sum())])
    return np.array(chosen)


def centre_on_planes(layers: Layers, planes: Floats, components: int, rng: np.random.Generator) -> None:
    """Let the mixture that `layers` give start with components on some of the demonstrated planes (n, 4), and wide."""
    weight, bias = layers[-1]
    with torch.no_grad():
        means = spread_out(planes, components, rng)
        bias[components : 5 * components] = torch.tensor(means.ravel(), dtype=torch.float32)
        weight.mul_(0.1)


def _inputs_and_planes(cuts: Sequence[DemonstratedPlane], k: int) -> tuple[Floats, Floats]:
    """Inputs (4 n, 2 k + 17) and planes (4 n, 4), d divided by the scale: of each cut under each of the four flips."""
    x, y = [], []
    for cut in cuts:
        scale = scale_of(cut.z[0])
        for z, flip in zip(cut.z, FLIPS, strict=True):
            plane = cut.plane_C.transformed(flip)
            x.append(inputs_of(cut.production, z, k))
            y.append(np.append(plane.normal, plane.offset / scale))
    return np.array(x), np.array(y)


def _train(
    x: Floats,
    y: Floats,
    k: int,
    settings: PlaneSettings,
    seed: int,
    epochs: int,
    held_out: tuple[Floats, Floats] | None = None,
) -> tuple[MLP, list[float]]:
    """The network, and the summed loss of the `held_out` inputs and planes after each epoch [nats]."""
    mean, deviation = np.zeros(x.shape[1]), np.ones(x.shape[1])
    mean[2 * k :], deviation[2 * k :] = x[:, 2 * k :].mean(axis=0), deviation_of(x[:, 2 * k :])
    rng = stream(seed, "planes", "weights")
    m = settings.n_components
    layers = initialise((x.shape[1], settings.hidden_size, numbers_of(m, 4)), rng)
    centre_on_planes(layers, y, m, rng)

    def tensors(inputs: Floats, planes: Floats) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.tensor((inputs - mean) / deviation, dtype=torch.float32), torch.tensor(planes, dtype=torch.float32)

    def losses(inputs: torch.Tensor, planes: torch.Tensor) -> torch.Tensor:
        return -log_folded(forward(layers, inputs), planes, m, settings.min_sigma)

    inputs, planes = tensors(x, y)
    generator = torch.Generator().manual_seed(torch_seed(seed, "planes", "jitter"))
    jitter = torch.tensor(np.where(np.arange(x.shape[1]) < 2 * k, 0.0, settings.jitter), dtype=torch.float32)

    def loss() -> torch.Tensor:
        return losses(inputs + jitter * torch.randn(inputs.shape, generator=generator), planes).mean()

    validate: Callable[[], float] | None = None
    if held_out is not None:
        held = tensors(*held_out)

        def validate() -> float:
            return float(losses(*held).sum())

    measured = fit(layers, loss, epochs, settings.learning_rate, settings.weight_decay, validate)
    return with_standardised_inputs(to_mlp(layers), mean, deviation), measured
