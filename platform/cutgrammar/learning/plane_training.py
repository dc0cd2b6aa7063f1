"""Training the mixture density network for cutting planes on demonstrated cuts (III-C).

The signs of the canonical frame are noise for many fragments, so the network is trained on all four flips of a
fragment. (n, d) and (-n, -d) are the same plane, so the mixture is folded: the density of a plane is the sum over both.
A hundred cuts are few: z is jittered anew in every epoch, and a floor of the standard deviations keeps the Gaussians
from collapsing onto single demonstrations. The length of training is fixed, because the held-out likelihood is best
long before the planes that are taken are (see docs/decisions.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cutgrammar.cutting.planes import PlaneNetwork, inputs_of
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.production import Production
from cutgrammar.learning.plane_validation import PlaneValidation, validate_planes
from cutgrammar.nn.cross_validation import Progress, fit_and_validate
from cutgrammar.nn.mixture import Mixture, numbers_of, parts_of
from cutgrammar.nn.mlp import MLP, deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Layers, batches, deterministic, fit, forward, initialise, to_mlp
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
        is_whole: whether the fragment that was cut is a whole object, which no cut made.
    """

    production: Production
    z: Floats
    plane_C: Plane
    group: int
    is_whole: bool = False


def fit_planes(
    cuts: Sequence[DemonstratedPlane],
    k: int,
    settings: PlaneSettings,
    seed: int,
    progress: Progress | None = None,
) -> tuple[PlaneNetwork, PlaneValidation]:
    """Train the mixture density network on the training cuts (III-C).

    Args:
        cuts: the cuts.
        k: number of fragment types.
        settings: size of the network and of the training.
        seed: of the initial weights and the folds.
        progress: see `fit_and_validate`.

    Raises:
        ValueError: no cuts.
    """
    if not cuts:
        raise ValueError("a network for cutting planes needs at least one cut")
    x, y = _inputs_and_planes(cuts, k)

    def rows_of(numbers: Ints) -> Ints:
        return np.asarray((len(FLIPS) * numbers[:, None] + np.arange(len(FLIPS))).ravel())

    def network(layers: MLP) -> PlaneNetwork:
        return PlaneNetwork(k, settings.n_components, settings.min_sigma, layers)

    def train(rows: Ints, held: Ints) -> tuple[PlaneNetwork, list[float]]:
        fit, others = rows_of(rows), rows_of(held)
        layers, losses = _train(x[fit], y[fit], k, settings, seed, (x[others], y[others]))
        return network(layers), losses

    def mixture(one: PlaneNetwork, row: int) -> Mixture:
        return one.mixture(cuts[row].production, cuts[row].z[0])

    with deterministic():
        groups, rng = np.array([cut.group for cut in cuts]), stream(seed, "planes", "folds")
        found = fit_and_validate(groups, settings.n_folds, rng, train, progress)
    planes = y.reshape(len(cuts), len(FLIPS), 4)
    whole = np.flatnonzero([cut.is_whole for cut in cuts])
    return found.fitted, validate_planes(found, mixture, planes, whole, settings)


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
    held_out: tuple[Floats, Floats],
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
    inputs, planes = (rows.reshape(-1, len(FLIPS), rows.shape[1]) for rows in (inputs, planes))
    generator = torch.Generator().manual_seed(torch_seed(seed, "planes", "jitter"))
    rows_of_step = batches(len(inputs), settings.batch_size, generator)
    jitter = torch.tensor(np.where(np.arange(x.shape[1]) < 2 * k, 0.0, settings.jitter), dtype=torch.float32)

    def loss() -> torch.Tensor:
        rows = rows_of_step()
        chosen, targets = inputs[rows].flatten(0, 1), planes[rows].flatten(0, 1)
        return losses(chosen + jitter * torch.randn(chosen.shape, generator=generator), targets).mean()

    held = tensors(*held_out)
    measured = fit(
        layers,
        loss,
        settings.epochs,
        settings.learning_rate,
        settings.weight_decay,
        lambda: float(losses(*held).sum()),
    )
    return with_standardised_inputs(to_mlp(layers), mean, deviation), measured
