"""The naive point-cloud encoder of III-D, trained with an implicit decoder in the manner of IM-NET.

Encoder: a shared MLP over the coordinates and normals of every point, then average pooling, to z_shape. The pooling
stands before the last, linear layer, which gives the same numbers for less work. Decoder: (z_shape, point) -> whether
the point lies inside. Both see fragments in their canonical frames, divided by their scales; each step turns every
fragment by one of the four proper flips, since the signs of a canonical frame are noise for many fragments.

After training z_shape is moved and scaled, by one number for all its entries, so that over the training fragments its
mean is zero and its total variance 1 (relative distances stay as learned).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.perception.layers import Layers, Parameters, finished, forward, initial, one_thread, tensors_of
from cutgrammar.perception.occupancy import inside
from cutgrammar.settings import FeatureSettings

POOL = 2048
"""Inside/outside points prepared for each training fragment; every step draws some of them."""


@dataclass(frozen=True, eq=False)
class Encoder:
    """Point cloud -> z_shape.

    Attributes:
        points: (6, ..., hidden) the shared layers; all of them are rectified, the last one too.
        pooled: (hidden, shape_size) the linear layer after the pooling.
    """

    points: Layers
    pooled: Layers

    def __call__(self, cloud: Cloud) -> Floats:
        """z_shape (shape_size,) of a cloud in its canonical frame, divided by its scale."""
        features = np.maximum(self.points(np.hstack([cloud.points, cloud.normals])), 0.0)
        return np.asarray(self.pooled(features.mean(axis=0)[None])[0])


@dataclass(frozen=True, eq=False)
class Decoder:
    """(z_shape, point) -> probability that the point lies inside."""

    layers: Layers

    def __call__(self, z_shape: Floats, points: Floats) -> Floats:
        """(n,) for points (n, 3) in the canonical frame, divided by the scale."""
        rows = np.hstack([np.broadcast_to(z_shape, (len(points), len(z_shape))), points])
        return np.asarray(1.0 / (1.0 + np.exp(-self.layers(rows)[:, 0])))


@dataclass(frozen=True, eq=False)
class EncoderTraining:
    """What training gave.

    Attributes:
        encoder: the encoder.
        decoder: its decoder.
        losses: mean binary cross entropy of every epoch [nats].
    """

    encoder: Encoder
    decoder: Decoder
    losses: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Shape:
    """A training fragment in its canonical frame, divided by its scale.

    Attributes:
        cloud: surface points with normals.
        queries: (POOL, 3) points inside and outside.
        labels: (POOL,) which of them lie inside.
    """

    cloud: Cloud
    queries: Floats
    labels: NDArray[np.bool_]

    def __post_init__(self) -> None:
        object.__setattr__(self, "queries", frozen_floats(self.queries, (None, 3), "queries"))


def shape_with_queries(mesh: Mesh, cloud: Cloud, rng: np.random.Generator) -> Shape:
    """A training fragment: half of its queries near the surface, the rest uniform in its box and in the unit cube.

    Args:
        mesh: closed mesh in its canonical frame, divided by its scale.
        cloud: its surface points.
        rng: draws the queries.
    """
    near, box = POOL // 2, POOL // 4
    chosen = rng.integers(len(cloud.points), size=near)
    spread = rng.choice([0.02, 0.1], size=(near, 1))
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    margin = 0.1 * (highest - lowest)
    queries = np.concatenate(
        [
            cloud.points[chosen] + spread * rng.normal(size=(near, 3)),
            rng.uniform(lowest - margin, highest + margin, size=(box, 3)),
            rng.uniform(-1.0, 1.0, size=(POOL - near - box, 3)),
        ]
    )
    return Shape(cloud, queries, inside(mesh, queries))


def fit_encoder(
    shapes: Sequence[Shape],
    settings: FeatureSettings,
    rng: np.random.Generator,
    on_epoch: Callable[[int, float], Any] | None = None,
) -> EncoderTraining:
    """Train encoder and decoder on `shapes` by binary cross entropy (III-D, IM-NET).

    Args:
        shapes: the training fragments, all with the same number of surface points.
        settings: sizes and length of the training.
        rng: initial weights, order, flips and the points drawn in each step.
        on_epoch: told the number of every finished epoch, from 1, and its loss.

    Raises:
        ValueError: no shapes.
    """
    if not shapes:
        raise ValueError("an encoder needs at least one training fragment")
    h = settings.hidden
    clouds = np.stack([np.hstack([s.cloud.points, s.cloud.normals]) for s in shapes]).astype(np.float32)
    queries = np.stack([s.queries for s in shapes]).astype(np.float32)
    labels = np.stack([s.labels for s in shapes]).astype(np.float32)
    signs = np.stack([np.diag(flip.rotation) for flip in FLIPS]).astype(np.float32)
    with one_thread():
        points, pooled = initial((6, h, h), rng), initial((h, settings.shape_size), rng)
        decoder = initial((settings.shape_size + 3, h, h, 1), rng)
        parameters = tensors_of(points) + tensors_of(pooled) + tensors_of(decoder)
        optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate)
        steps = settings.epochs * -(-len(shapes) // settings.batch)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, total_steps=steps + 1)
        losses = []
        for epoch in range(settings.epochs):
            total = 0.0
            order = rng.permutation(len(shapes))
            for start in range(0, len(shapes), settings.batch):
                rows = order[start : start + settings.batch]
                flips = signs[rng.integers(4, size=len(rows))][:, None, :]
                some = rng.permutation(clouds.shape[1])[: settings.points_a_step]
                asked = rng.permutation(POOL)[: settings.queries]
                cloud = clouds[rows][:, some] * np.tile(flips, 2)
                z = _encoded(points, pooled, torch.from_numpy(cloud))
                at = torch.from_numpy(queries[rows][:, asked] * flips)
                pairs = torch.cat([z[:, None, :].expand(-1, at.shape[1], -1), at], dim=2)
                logits = forward(decoder, pairs)[..., 0]
                truth = torch.from_numpy(labels[rows][:, asked])
                loss = torch.nn.functional.binary_cross_entropy_with_logits(logits, truth)
                optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                schedule.step()
                total += float(loss.detach()) * len(rows)
            losses.append(total / len(shapes))
            if on_epoch is not None:
                on_epoch(epoch + 1, losses[-1])
    raw = Encoder(finished(points), finished(pooled))
    return EncoderTraining(*_standardised(raw, finished(decoder), shapes), tuple(losses))


def flipped(cloud: Cloud) -> tuple[Cloud, ...]:
    """A cloud in its canonical frame under each of `FLIPS`."""
    return tuple(Cloud(flip.turn(cloud.points), flip.turn(cloud.normals)) for flip in FLIPS)


def _encoded(points: Parameters, pooled: Parameters, clouds: torch.Tensor) -> torch.Tensor:
    return forward(pooled, torch.relu(forward(points, clouds)).mean(dim=1))


def _standardised(raw: Encoder, decoder: Layers, shapes: Sequence[Shape]) -> tuple[Encoder, Decoder]:
    """The same networks with z_shape of mean zero and total variance 1 over the shapes in all flips."""
    z = np.array([raw(cloud) for shape in shapes for cloud in flipped(shape.cloud)])
    mean = z.mean(axis=0)
    unit = float(np.sqrt(z.var(axis=0).sum())) or 1.0
    weight, bias = raw.pooled.weights[0], raw.pooled.biases[0]
    encoder = Encoder(raw.points, Layers((weight / unit,), ((bias - mean) / unit,)))
    first, size = decoder.weights[0], len(mean)
    first_bias = decoder.biases[0] + mean @ first[:size]
    first = np.concatenate([first[:size] * unit, first[size:]])
    return encoder, Decoder(Layers((first, *decoder.weights[1:]), (first_bias, *decoder.biases[1:])))
