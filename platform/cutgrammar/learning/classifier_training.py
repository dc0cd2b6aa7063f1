"""Fitting the fragment-type classifier p(c|z) to the clustered fragments (II-B).

How long to train is chosen by cross-validation, as the number of epochs with the least held-out loss; the temperature
that divides the logits is the one that makes the held-out probabilities most likely. Where there is one group only,
nothing can be held out: all epochs are used and the temperature is 1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.optimize import minimize_scalar

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.cross_validation import best_epoch, folds_of
from cutgrammar.nn.mlp import deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Parameters, descend, finished, forward, initial, one_thread
from cutgrammar.perception.classifier import TypeClassifier, log_probabilities
from cutgrammar.seeds import stream
from cutgrammar.settings import ClassifierSettings


@dataclass(frozen=True)
class Validation:
    """What cross-validation chose and found.

    Attributes:
        epochs: length of the training.
        temperature: divides the logits.
        losses: held-out cross entropy after each epoch [nats], empty where nothing could be held out.
        accuracy: share of held-out rows whose type was the most probable one, None likewise.
        log_likelihood: mean calibrated log p(c|z) of the held-out rows [nats], None likewise.
    """

    epochs: int
    temperature: float
    losses: tuple[float, ...] = ()
    accuracy: float | None = None
    log_likelihood: float | None = None


def fit_classifier(
    z: Floats,
    types: Ints,
    k: int,
    settings: ClassifierSettings,
    seed: int,
    groups: Ints | None = None,
    validation: Validation | None = None,
) -> TypeClassifier:
    """Fit p(c|z) on the clustered training fragments (II-B).

    Args:
        z: (n, 17) shape features.
        types: (n,) fragment type of each, from 0 to k - 1.
        k: number of fragment types.
        settings: size and length of the training.
        seed: of the initial weights and the folds.
        groups: (n,) what is held out together, e.g. the number of the trial; each row by itself if not given.
        validation: from `cross_validate` with the same arguments, where it was called before.

    Raises:
        ValueError: no rows, or a type outside 0 to k - 1.
    """
    _check(z, types, k)
    chosen = validation or cross_validate(z, types, k, settings, seed, groups)
    with one_thread():
        layers, seen, mean, deviation = _trained(z, types, settings, seed, chosen.epochs)
        return TypeClassifier(k, with_standardised_inputs(finished(layers), mean, deviation), seen, chosen.temperature)


def cross_validate(
    z: Floats, types: Ints, k: int, settings: ClassifierSettings, seed: int, groups: Ints | None = None
) -> Validation:
    """Choose length of training and temperature on held-out rows; the arguments are those of `fit_classifier`."""
    _check(z, types, k)
    rows = np.arange(len(z)) if groups is None else np.asarray(groups)
    folds = folds_of(rows, settings.n_folds, stream(seed, "classifier", "folds"))
    if not folds:
        return Validation(settings.max_epochs, 1.0)
    with one_thread():
        sums, counted = np.zeros(settings.max_epochs), 0
        for fit, held in folds:
            known = held[np.isin(types[held], types[fit])]
            curve: list[float] = []
            _trained(z[fit], types[fit], settings, seed, settings.max_epochs, (z[known], types[known], curve))
            sums += np.array(curve)
            counted += len(known)
        losses = tuple(float(value) for value in sums / max(counted, 1))
        epochs = best_epoch(losses)
        answers = []
        for fit, held in folds:
            layers, seen, mean, deviation = _trained(z[fit], types[fit], settings, seed, epochs)
            answers.append((finished(layers)((z[held] - mean) / deviation), seen, types[held]))

    def loss(log_temperature: float) -> float:
        return -float(np.concatenate(_held_out(answers, k, float(np.exp(log_temperature)))[0]).mean())

    temperature = float(np.exp(minimize_scalar(loss, bounds=(-3.0, 3.0), method="bounded").x))
    log_p, right = _held_out(answers, k, temperature)
    return Validation(
        epochs, temperature, losses, float(np.concatenate(right).mean()), float(np.concatenate(log_p).mean())
    )


def _check(z: Floats, types: Ints, k: int) -> None:
    if not len(z) or len(z) != len(types):
        raise ValueError(f"{len(z)} features and {len(types)} types; as many of each were expected, and at least one")
    if types.min() < 0 or types.max() >= k:
        raise ValueError(f"fragment types lie outside 0 to {k - 1}")


def _trained(
    z: Floats,
    types: Ints,
    settings: ClassifierSettings,
    seed: int,
    epochs: int,
    watched: tuple[Floats, Ints, list[float]] | None = None,
) -> tuple[Parameters, tuple[int, ...], Floats, Floats]:
    """Layers for standardised z, their types, and the mean and deviation of z; `watched` collects summed losses."""
    mean, deviation = z.mean(axis=0), deviation_of(z)
    seen = np.unique(types)
    rng = stream(seed, "classifier", "weights")
    layers = initial((z.shape[1], settings.hidden_size, len(seen)), rng)

    def rows(features: Floats, labels: Ints) -> tuple[torch.Tensor, torch.Tensor]:
        inputs = torch.tensor((features - mean) / deviation, dtype=torch.float32)
        return inputs, torch.tensor(np.searchsorted(seen, labels))

    def loss(pair: tuple[torch.Tensor, torch.Tensor], reduction: str = "mean") -> torch.Tensor:
        return torch.nn.functional.cross_entropy(forward(layers, pair[0]), pair[1], reduction=reduction)

    fitted = rows(z, types)
    watch: Callable[[], Any] | None = None
    if watched is not None:
        held, curve = rows(*watched[:2]), watched[2]

        def watch() -> None:
            curve.append(float(loss(held, "sum")))

    descend(layers, lambda: loss(fitted), epochs, settings.learning_rate, settings.weight_decay, watch)
    return layers, tuple(int(c) for c in seen), mean, deviation


def _held_out(
    answers: list[tuple[Floats, tuple[int, ...], Ints]], k: int, temperature: float
) -> tuple[list[Floats], list[Floats]]:
    """For every fold: log p of the true types, and whether they were the most probable ones."""
    log_p, right = [], []
    for logits, seen, types in answers:
        p = log_probabilities(logits / temperature, seen, k)
        log_p.append(p[np.arange(len(types)), types])
        right.append((p.argmax(axis=1) == types).astype(np.float64))
    return log_p, right
