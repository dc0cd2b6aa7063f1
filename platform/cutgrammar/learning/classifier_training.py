"""Fitting the fragment-type classifier p(c|z) to the clustered fragments (II-B).

Types are clusters by distance, so the features keep the common scale in which they were clustered: with each divided
by its own deviation, the network would look most at what tells the types apart least. Fragments are few for as many
types, and are jittered anew in every step. The length of training is fixed. Cross-validation chooses the temperature
that divides the logits, as the one with the highest held-out likelihood. With a single group nothing can be held out,
and the temperature is 1.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.cross_validation import Progress, Validated, fit_and_validate
from cutgrammar.nn.mlp import MLP, common_deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import batches, deterministic, fit, forward, initialise, to_mlp
from cutgrammar.perception.classifier import TypeClassifier, log_probabilities
from cutgrammar.seeds import stream, torch_seed
from cutgrammar.settings import ClassifierSettings

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Validation:
    """What cross-validation chose and measured.

    Attributes:
        temperature: divides the logits.
        losses: held-out cross entropy after each epoch [nats], empty where nothing could be held out.
        accuracy: share of held-out rows whose type was the most probable one; None where nothing could be held out.
        log_likelihood: mean calibrated log p(c|z) of the held-out rows whose type the others have [nats]; None where
            nothing could be held out.
        unseen: share of the held-out rows whose type only held-out rows have; None where nothing could be held out.
    """

    temperature: float
    losses: tuple[float, ...] = ()
    accuracy: float | None = None
    log_likelihood: float | None = None
    unseen: float | None = None

    @property
    def metrics(self) -> dict[str, float | None]:
        """What was measured, by the name it has among a model's metrics."""
        return {
            "classifier_temperature": self.temperature,
            "classifier_held_out_accuracy": self.accuracy,
            "classifier_held_out_log_likelihood": self.log_likelihood,
            "classifier_held_out_unseen_types": self.unseen,
        }


def fit_classifier(
    z: Floats,
    types: Ints,
    k: int,
    settings: ClassifierSettings,
    seed: int,
    groups: Ints | None = None,
    progress: Progress | None = None,
) -> tuple[TypeClassifier, Validation]:
    """Fit p(c|z) on the clustered training fragments, with a temperature chosen on held-out ones (II-B).

    Args:
        z: (n, 17) shape features.
        types: (n,) fragment type of each, from 0 to k - 1.
        k: number of fragment types.
        settings: size of the network and of the training.
        seed: of the initial weights and the folds.
        groups: (n,) rows of one group, e.g. of one trial, are held out together; None: each row is a group.
        progress: see `fit_and_validate`.

    Raises:
        ValueError: no rows, or a type outside 0 to k - 1.
    """
    if not len(z) or len(z) != len(types):
        raise ValueError(f"{len(z)} features and {len(types)} types; as many of each were expected, and at least one")
    if types.min() < 0 or types.max() >= k:
        raise ValueError(f"fragment types lie outside 0 to {k - 1}")
    groups = np.arange(len(z)) if groups is None else groups
    with deterministic():
        n_known = 0

        def train(rows: Ints, held: Ints) -> tuple[_Fitted, list[float]]:
            nonlocal n_known
            known = held[np.isin(types[held], types[rows])]
            n_known += len(known)
            return _train(z[rows], types[rows], settings, seed, (z[known], types[known]))

        found = fit_and_validate(groups, settings.n_folds, stream(seed, "classifier", "folds"), train, progress)
    validation = _validation(found, found.losses(n_known), z, types, k)
    fitted = found.fitted
    layers = with_standardised_inputs(fitted.layers, fitted.mean, fitted.deviation)
    return TypeClassifier(k, layers, fitted.types, validation.temperature), validation


def _validation(found: "Validated[_Fitted]", losses: tuple[float, ...], z: Floats, types: Ints, k: int) -> Validation:
    """Choose the temperature on held-out rows, and measure them."""
    if not found.folds:
        return Validation(1.0)
    answers = [
        (one.layers((z[held] - one.mean) / one.deviation), one.types, types[held])
        for (_, held), one in zip(found.folds, found.networks, strict=True)
    ]

    def loss(log_temperature: float) -> float:
        return -float(_held_out(answers, k, float(np.exp(log_temperature)))[0].mean())

    temperature = float(np.exp(minimize_scalar(loss, bounds=(-3.0, 3.0), method="bounded").x))
    log_p, right, seen = _held_out(answers, k, temperature)
    return Validation(
        temperature,
        losses,
        float(right.mean()),
        float(log_p[seen].mean()) if seen.any() else None,
        float(1.0 - seen.mean()),
    )


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A trained network.

    Attributes:
        layers: standardised z -> logits.
        types: the type of each logit; those that occur in the rows it was fitted to.
        mean, deviation: (17,) what z is standardised by.
    """

    layers: MLP
    types: tuple[int, ...]
    mean: Floats
    deviation: Floats


def _train(
    z: Floats,
    types: Ints,
    settings: ClassifierSettings,
    seed: int,
    held_out: tuple[Floats, Ints],
) -> tuple[_Fitted, list[float]]:
    """Train on features z (n, 17) and types (n,); also the summed loss of the `held_out` after each epoch [nats]."""
    mean, deviation = z.mean(axis=0), common_deviation_of(z)
    known = np.unique(types)
    layers = initialise((z.shape[1], settings.hidden_size, len(known)), stream(seed, "classifier", "weights"))

    def tensors(features: Floats, of_types: Ints) -> tuple[torch.Tensor, torch.Tensor]:
        standardised = torch.tensor((features - mean) / deviation, dtype=torch.float32)
        return standardised, torch.tensor(np.searchsorted(known, of_types))

    def loss(pair: tuple[torch.Tensor, torch.Tensor], reduction: str = "mean") -> torch.Tensor:
        return torch.nn.functional.cross_entropy(forward(layers, pair[0]), pair[1], reduction=reduction)

    inputs, labels = tensors(z, types)
    generator = torch.Generator().manual_seed(torch_seed(seed, "classifier", "batches"))
    rows_of_step = batches(len(z), settings.batch_size, generator)
    held = tensors(*held_out)

    def loss_of_step() -> torch.Tensor:
        rows = rows_of_step()
        chosen = inputs[rows]
        return loss((chosen + settings.jitter * torch.randn(chosen.shape, generator=generator), labels[rows]))

    losses = fit(
        layers,
        loss_of_step,
        settings.epochs,
        settings.learning_rate,
        settings.weight_decay,
        lambda: float(loss(held, "sum")),
    )
    return _Fitted(to_mlp(layers), tuple(int(c) for c in known), mean, deviation), losses


def _held_out(
    answers: list[tuple[Floats, tuple[int, ...], Ints]], k: int, temperature: float
) -> tuple[Floats, Flags, Flags]:
    """Of all held-out rows, from each fold's (logits, their types, true types).

    Returns:
        The log p of the true types, whether they are the most probable ones, and whether there is a logit for them.
    """
    log_p, right, seen = [], [], []
    for logits, known, types in answers:
        p = log_probabilities(logits / temperature, known, k)
        log_p.append(p[np.arange(len(types)), types])
        right.append(p.argmax(axis=1) == types)
        seen.append(np.isin(types, known))
    return np.concatenate(log_p), np.concatenate(right), np.concatenate(seen)
