"""The naive point-cloud encoder of III-D, and the implicit decoder that it is trained with, as in IM-NET.

Encoder: a shared MLP on the coordinates and normals of every point, followed by average pooling, gives z_shape. The
pooling is applied before the last, linear layer, which is equivalent and cheaper. Decoder: (z_shape, point) -> whether
the point is inside. The inputs of both are fragments in their canonical frames, divided by their scales.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.fragment import Cloud
from cutgrammar.nn.mlp import MLP


@dataclass(frozen=True, eq=False)
class Encoder:
    """Point cloud -> z_shape.

    Attributes:
        points: (6, ..., hidden) the shared layers; a ReLU follows each of them, including the last.
        pooled: (hidden, shape_size) the linear layer after pooling.
    """

    points: MLP
    pooled: MLP

    def __call__(self, cloud: Cloud) -> Floats:
        """z_shape (shape_size,) of a cloud in its canonical frame, divided by its scale."""
        features = np.maximum(self.points(np.hstack([cloud.points, cloud.normals])), 0.0)
        return np.asarray(self.pooled(features.mean(axis=0)[None])[0])


@dataclass(frozen=True, eq=False)
class Decoder:
    """(z_shape, point) -> probability that the point is inside."""

    layers: MLP

    def __call__(self, z_shape: Floats, points: Floats) -> Floats:
        """(n,) for points (n, 3) in the canonical frame, divided by the scale."""
        rows = np.hstack([np.broadcast_to(z_shape, (len(points), len(z_shape))), points])
        return np.asarray(1.0 / (1.0 + np.exp(-self.layers(rows)[:, 0])))


def flipped(cloud: Cloud) -> tuple[Cloud, ...]:
    """A cloud in its canonical frame under each of `FLIPS`."""
    return tuple(Cloud(flip.rotate(cloud.points), flip.rotate(cloud.normals)) for flip in FLIPS)
