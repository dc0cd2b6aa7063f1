"""Stability of the shape feature under changes that leave the shape as it is (III-D).

The changes are another pose, another triangulation and other surface points. Distances are those of z_shape, whose
total variance over the training fragments is 1; z_scale is reported separately.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import mesh_of, solid_of
from cutgrammar.perception.encoder import flipped
from cutgrammar.perception.feature import FeatureExtractor, normalised

DENSITY = 20
"""Random points are drawn from this multiple of evenly distributed points."""
COARSE = 0.01
"""Maximum displacement of the surface by `coarser`, as a share of the scale."""

Change = Callable[[FeatureExtractor, Mesh, np.random.Generator], Floats]
"""(4, shape_size + 1) z of a changed fragment under each of `FLIPS`."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """How far a change moves z, for each fragment.

    Attributes:
        before, after: (n, shape_size + 1) z without and with the change.
        shape: (n,) distance between their z_shape.
        shape_best_flip: (n,) the same for the best of the four flips after the change.
        scale: (n,) difference of their z_scale.
    """

    before: Floats
    after: Floats
    shape: Floats
    shape_best_flip: Floats
    scale: Floats


def shifts(features: FeatureExtractor, meshes: Sequence[Mesh], change: Change, rng: np.random.Generator) -> Shifts:
    """How far `change`, one of `CHANGES`, moves z of `meshes`."""
    before = np.array([features(mesh) for mesh in meshes])
    after = np.array([change(features, mesh, rng) for mesh in meshes])
    distances = np.linalg.norm(after[:, :, :-1] - before[:, None, :-1], axis=2)
    scale = np.abs(after[:, 0, -1] - before[:, -1])
    return Shifts(before, after[:, 0], distances[:, 0], distances.min(axis=1), scale)


def moved(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Apply a random rigid motion."""
    return mesh.moved(Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1.0, 1.0, size=3)))


def renumbered(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Shuffle vertices and triangles."""
    order = rng.permutation(len(mesh.vertices))
    return Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))])


def finer(mesh: Mesh, _: np.random.Generator) -> Mesh:
    """Divide every triangle into four."""
    fine = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).subdivide()
    return Mesh(fine.vertices, fine.faces)


def coarser(mesh: Mesh, _: np.random.Generator) -> Mesh:
    """Simplify the mesh; the surface moves by at most `COARSE` times the scale."""
    scale = normalised(mesh, 32).scale
    return mesh_of(solid_of(mesh).simplify(COARSE * scale))


def scanned(mesh: Mesh, rng: np.random.Generator, points: int) -> Cloud:
    """A cloud of random surface points, which also determine frame, centroid and scale."""
    return _some(sample_surface(mesh, DENSITY * points), points, rng)


def of_changed(
    change: Callable[[Mesh, np.random.Generator], Mesh | Cloud],
    features: FeatureExtractor,
    mesh: Mesh,
    rng: np.random.Generator,
) -> Floats:
    """(4, shape_size + 1) z of the mesh after `change`."""
    return features.flipped(change(mesh, rng))


def at_other_points(features: FeatureExtractor, mesh: Mesh, rng: np.random.Generator) -> Floats:
    """(4, shape_size + 1) z from the same number of random surface points in the canonical frame of the mesh."""
    seen = normalised(mesh, DENSITY * features.points)
    shape = [features.encoder(cloud) for cloud in flipped(_some(seen.cloud, features.points, rng))]
    return np.column_stack([shape, np.full(len(shape), features(mesh)[-1])])


def _some(cloud: Cloud, points: int, rng: np.random.Generator) -> Cloud:
    chosen = rng.choice(len(cloud.points), size=points, replace=False)
    return Cloud(cloud.points[chosen], cloud.normals[chosen])


CHANGES: Mapping[str, Change] = MappingProxyType(
    {
        "rigid motion": partial(of_changed, moved),
        "renumbered": partial(of_changed, renumbered),
        "finer mesh": partial(of_changed, finer),
        "coarser mesh": partial(of_changed, coarser),
        "other points": at_other_points,
        "cloud of 1024": partial(of_changed, partial(scanned, points=1024)),
        "cloud of 256": partial(of_changed, partial(scanned, points=256)),
    }
)
"""The changes by name. The first only affects rounding; clouds change z most, because their frames are estimated."""
