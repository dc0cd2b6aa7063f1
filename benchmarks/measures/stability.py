"""What should not change a shape feature, and how far each of these moves it (III-D).

A fragment may lie elsewhere, be made of other triangles, or be seen at other surface points; its shape stays the same.
Distances are those of z_shape, whose total variance over the training fragments is 1; z_scale stands apart.
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

DENSE = 20
"""Points drawn at random are taken from so many times as many that are spread evenly."""
COARSE = 0.01
"""How far `coarser` may move the surface, as a share of the scale."""

Change = Callable[[FeatureExtractor, Mesh, np.random.Generator], Floats]
"""(4, shape_size + 1) z of a changed fragment under each of `FLIPS`."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """How far one change moves z, fragment by fragment.

    Attributes:
        before, after: (n, shape_size + 1) z without and with the change.
        shape: (n,) distance between their z_shape.
        shape_best_flip: (n,) the same if the best of the four flips is taken after the change.
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
    """Turned and shifted at random."""
    return mesh.moved(Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1.0, 1.0, size=3)))


def renumbered(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """The same triangles; corners and triangles in another order."""
    order = rng.permutation(len(mesh.vertices))
    return Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))])


def finer(mesh: Mesh, _: np.random.Generator) -> Mesh:
    """Every triangle made into four of the same plane."""
    fine = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).subdivide()
    return Mesh(fine.vertices, fine.faces)


def coarser(mesh: Mesh, _: np.random.Generator) -> Mesh:
    """Fewer triangles; the surface moves by at most `COARSE` times the scale."""
    scale = normalised(mesh, 32).scale
    return mesh_of(solid_of(mesh).simplify(COARSE * scale))


def scanned(mesh: Mesh, rng: np.random.Generator, points: int) -> Cloud:
    """Surface points drawn at random and nothing else: frame, centroid and scale then come from them too."""
    return _some(sample_surface(mesh, DENSE * points), points, rng)


def of_changed(
    change: Callable[[Mesh, np.random.Generator], Mesh | Cloud],
    features: FeatureExtractor,
    mesh: Mesh,
    rng: np.random.Generator,
) -> Floats:
    """(4, shape_size + 1) z of a mesh that `change` has changed."""
    return features.flipped(change(mesh, rng))


def at_other_points(features: FeatureExtractor, mesh: Mesh, rng: np.random.Generator) -> Floats:
    """(4, shape_size + 1) z from as many surface points, drawn at random, in the canonical frame of the mesh."""
    seen = normalised(mesh, DENSE * features.points)
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
"""By name. The first changes nothing but rounding; the clouds change most, as their frames are estimated anew."""
