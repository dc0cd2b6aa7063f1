"""The shape feature z = (z_shape, z_scale) of III-D, and the scale by which shapes are normalised.

The scale of a fragment is the maximum absolute coordinate of its vertices or points in its canonical frame [m]. The
paper gives no unit for z_scale. Reading taken: z_scale is twice the natural logarithm of scale / 1 cm, e.g. 0 for 1 cm
and 4.6 for 10 cm. Equal differences are then equal ratios of scale, and over the fragments of a data set z_scale varies
about as much as all of z_shape.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Mesh, vertices_of
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar.nn.mlp import MLP, from_bytes, to_bytes, whole_in
from cutgrammar.perception.encoder import Encoder, flipped

UNIT = 0.01
"""The scale at which z_scale is 0 [m]."""
STEPS = 2.0
"""Increase of z_scale when the scale grows by a factor e."""
MAX_POINTS = 1_000_000
"""Largest number of surface points in a file."""


@dataclass(frozen=True, eq=False)
class Normalised:
    """A shape in its canonical frame, divided by its scale.

    Attributes:
        mesh: the mesh, or None for a cloud.
        cloud: surface points with normals.
        scale: the scale of the original shape [m].
    """

    mesh: Mesh | None
    cloud: Cloud
    scale: float


@dataclass(frozen=True, eq=False)
class FeatureExtractor:
    """Fragment -> z (shape_size + 1,).

    Attributes:
        encoder: the trained encoder.
        points: number of surface points in the encoder's input.
    """

    encoder: Encoder
    points: int

    def __call__(self, shape: Mesh | Cloud) -> Floats:
        """z of a mesh or cloud in its fragment's frame F; it does not depend on the pose of F.

        Raises:
            ValueError: a mesh without volume, or a cloud with fewer than four points.
        """
        seen = normalised(shape, self.points)
        return np.append(self.encoder(seen.cloud), z_scale(seen.scale))

    def flipped(self, shape: Mesh | Cloud) -> Floats:
        """(4, shape_size + 1) z of the shape under each of `FLIPS`; the first row is z itself."""
        seen = normalised(shape, self.points)
        return np.array([np.append(self.encoder(cloud), z_scale(seen.scale)) for cloud in flipped(seen.cloud)])

    @property
    def size(self) -> int:
        """Length of z."""
        return self.encoder.pooled.sizes[-1] + 1

    def to_bytes(self) -> bytes:
        """Serialise to the safetensors format."""
        pooled = self.encoder.pooled
        extras = {"pooled.weight": pooled.weights[0], "pooled.bias": pooled.biases[0]}
        return to_bytes(self.encoder.points, **extras, points=np.array([float(self.points)]))

    @staticmethod
    def from_bytes(data: bytes) -> "FeatureExtractor":
        """The inverse of `to_bytes`.

        Raises:
            ValueError: the bytes are not an encoder.
        """
        layers, others = from_bytes(data)
        if set(others) != {"pooled.weight", "pooled.bias", "points"} or layers.sizes[0] != 6:
            raise ValueError("not an encoder")
        pooled = MLP((others["pooled.weight"],), (others["pooled.bias"],))
        if pooled.sizes[0] != layers.sizes[-1]:
            raise ValueError("the layers of the encoder do not match")
        return FeatureExtractor(Encoder(layers, pooled), whole_in(others, "points", 1, MAX_POINTS))


def normalised(shape: Mesh | Cloud, points: int) -> Normalised:
    """Transform `shape` to its canonical frame, divide it by its scale, and sample `points` surface points.

    Raises:
        ValueError: a shape without volume or extent, or a cloud with fewer than four points.
    """
    X_CF = canonical_frame(shape).inverse()
    corners = X_CF.apply(vertices_of(shape))
    scale = float(np.abs(corners).max())
    if scale <= 0.0:
        raise ValueError("a shape without extent has no scale")
    cloud = cloud_of(shape, points)
    mesh = Mesh(corners / scale, shape.faces) if isinstance(shape, Mesh) else None
    return Normalised(mesh, Cloud(X_CF.apply(cloud.points) / scale, X_CF.rotate(cloud.normals)), scale)


def z_scale(scale: float) -> float:
    """z_scale of a fragment of this scale [m]."""
    return float(STEPS * np.log(scale / UNIT))


def scale_of(z: Floats) -> float:
    """The scale [m] of a fragment with feature z (shape_size + 1,)."""
    return float(UNIT * np.exp(z[-1] / STEPS))
