"""Training the encoder with its implicit decoder (III-D, IM-NET).

Each step turns every fragment by one of the four proper flips, because the signs of a canonical frame are noise for
many fragments. After training, z_shape is shifted and scaled by one common factor, so that over the training fragments
its mean is zero and its total variance 1; relative distances stay as learned.
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
from cutgrammar.nn.mlp import MLP
from cutgrammar.nn.mlp_training import Layers, deterministic, forward, initialise, parameters_of, to_mlp
from cutgrammar.perception.encoder import Decoder, Encoder, flipped
from cutgrammar.perception.feature import FeatureExtractor, normalised
from cutgrammar.perception.occupancy import inside
from cutgrammar.settings import FeatureSettings

POOL = 2048
"""Number of inside/outside points prepared for each training fragment; every step draws some of them."""


@dataclass(frozen=True, eq=False)
class EncoderTraining:
    """The result of training.

    Attributes:
        encoder: surface points -> z_shape.
        decoder: z_shape and a point -> whether it lies inside.
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


def fit_features(
    meshes: Sequence[Mesh],
    settings: FeatureSettings,
    rng: np.random.Generator,
    on_epoch: Callable[[int, float], Any] | None = None,
) -> tuple[FeatureExtractor, EncoderTraining]:
    """Train the encoder on the training fragments (III-D).

    Args:
        meshes: closed meshes of the training fragments, each in a frame F of its own [m]; of more than
            `settings.max_fragments`, so many are drawn.
        settings: sizes and length of the training.
        rng: draws queries, initial weights and steps.
        on_epoch: called with the number of every finished epoch, from 1, and its loss.

    Raises:
        ValueError: no meshes, or one without volume.
    """
    shapes = []
    chosen = np.arange(len(meshes))
    if len(meshes) > settings.max_fragments:
        chosen = np.sort(rng.permutation(len(meshes))[: settings.max_fragments])
    for i in chosen:
        scaled = normalised(meshes[int(i)], settings.n_points)
        assert scaled.mesh is not None
        shapes.append(shape_with_queries(scaled.mesh, scaled.cloud, rng))
    training = fit_encoder(shapes, settings, rng, on_epoch)
    return FeatureExtractor(training.encoder, settings.n_points), training


def shape_with_queries(mesh: Mesh, cloud: Cloud, rng: np.random.Generator) -> Shape:
    """A training fragment: half of its queries near the surface, the rest uniform in its box and in the unit cube.

    Args:
        mesh: closed mesh in its canonical frame, divided by its scale.
        cloud: its surface points.
        rng: draws the queries.
    """
    n_near, n_box = POOL // 2, POOL // 4
    chosen = rng.integers(len(cloud.points), size=n_near)
    deviation = rng.choice([0.02, 0.1], size=(n_near, 1))
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    margin = 0.1 * (highest - lowest)
    queries = np.concatenate(
        [
            cloud.points[chosen] + deviation * rng.normal(size=(n_near, 3)),
            rng.uniform(lowest - margin, highest + margin, size=(n_box, 3)),
            rng.uniform(-1.0, 1.0, size=(POOL - n_near - n_box, 3)),
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
        on_epoch: called with the number of every finished epoch, from 1, and its loss.

    Raises:
        ValueError: no shapes.
    """
    if not shapes:
        raise ValueError("an encoder needs at least one training fragment")
    h = settings.hidden_size
    clouds = np.stack([np.hstack([s.cloud.points, s.cloud.normals]) for s in shapes]).astype(np.float32)
    queries = np.stack([s.queries for s in shapes]).astype(np.float32)
    labels = np.stack([s.labels for s in shapes]).astype(np.float32)
    signs = np.stack([np.diag(flip.rotation) for flip in FLIPS]).astype(np.float32)
    with deterministic():
        points, pooled = initialise((6, h, h), rng), initialise((h, settings.shape_size), rng)
        decoder = initialise((settings.shape_size + 3, h, h, 1), rng)
        parameters = parameters_of(points) + parameters_of(pooled) + parameters_of(decoder)
        optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate)
        steps = settings.epochs * -(-len(shapes) // settings.batch_size)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, total_steps=steps + 1)
        losses = []
        for epoch in range(settings.epochs):
            total = 0.0
            order = rng.permutation(len(shapes))
            for start in range(0, len(shapes), settings.batch_size):
                rows = order[start : start + settings.batch_size]
                flips = signs[rng.integers(4, size=len(rows))][:, None, :]
                point_rows = rng.permutation(clouds.shape[1])[: settings.n_points_per_step]
                query_rows = rng.permutation(POOL)[: settings.n_queries]
                cloud = clouds[rows][:, point_rows] * np.tile(flips, 2)
                z = _encoded(points, pooled, torch.from_numpy(cloud))
                places = torch.from_numpy(queries[rows][:, query_rows] * flips)
                pairs = torch.cat([z[:, None, :].expand(-1, places.shape[1], -1), places], dim=2)
                logits = forward(decoder, pairs)[..., 0]
                truth = torch.from_numpy(labels[rows][:, query_rows])
                loss = torch.nn.functional.binary_cross_entropy_with_logits(logits, truth)
                optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                schedule.step()
                total += float(loss.detach()) * len(rows)
            losses.append(total / len(shapes))
            if on_epoch is not None:
                on_epoch(epoch + 1, losses[-1])
    raw = Encoder(to_mlp(points), to_mlp(pooled))
    return EncoderTraining(*_standardised(raw, to_mlp(decoder), shapes), tuple(losses))


def _encoded(points: Layers, pooled: Layers, clouds: torch.Tensor) -> torch.Tensor:
    return forward(pooled, torch.relu(forward(points, clouds)).mean(dim=1))


def _standardised(raw: Encoder, decoder: MLP, shapes: Sequence[Shape]) -> tuple[Encoder, Decoder]:
    """The networks with z_shape shifted and scaled to mean zero and total variance 1 over the shapes in all flips."""
    z = np.array([raw(cloud) for shape in shapes for cloud in flipped(shape.cloud)])
    mean = z.mean(axis=0)
    unit = float(np.sqrt(z.var(axis=0).sum())) or 1.0
    weight, bias = raw.pooled.weights[0], raw.pooled.biases[0]
    encoder = Encoder(raw.points, MLP((weight / unit,), ((bias - mean) / unit,)))
    first, size = decoder.weights[0], len(mean)
    first_bias = decoder.biases[0] + mean @ first[:size]
    first = np.concatenate([first[:size] * unit, first[size:]])
    return encoder, Decoder(MLP((first, *decoder.weights[1:]), (first_bias, *decoder.biases[1:])))
