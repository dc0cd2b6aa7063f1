"""Cutting a closed mesh by a plane into closed meshes: the Slice of Section IV, using manifold3d."""

from dataclasses import dataclass

import manifold3d
import numpy as np

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane


@dataclass(frozen=True, eq=False)
class Sliced:
    """The products of a cut, closed and connected meshes; those `above` are on the side that the normal points to."""

    above: tuple[Mesh, ...]
    below: tuple[Mesh, ...]

    @property
    def products(self) -> tuple[Mesh, ...]:
        """All products, starting with those above."""
        return self.above + self.below


@dataclass(frozen=True)
class Missed:
    """The plane does not divide the mesh; nothing is cut."""

    reason: str


def solid_of(mesh: Mesh) -> manifold3d.Manifold:
    """Convert a mesh to a manifold3d solid in double precision.

    Raises:
        ValueError: the mesh is not closed and oriented.
    """
    solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices.copy(), mesh.faces.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError:
        raise ValueError(f"the mesh is not a closed, oriented surface: {solid.status().name}")
    return solid


def mesh_of(solid: manifold3d.Manifold) -> Mesh:
    """Convert a manifold3d solid to a mesh."""
    raw = solid.to_mesh64()
    return Mesh(np.asarray(raw.vert_properties)[:, :3], np.asarray(raw.tri_verts))


def slice_mesh(mesh: Mesh, plane: Plane, min_share: float = 1e-6) -> Sliced | Missed:
    """Divide `mesh` by `plane`; every connected component of either half is a product.

    Args:
        mesh: closed mesh in a frame F.
        plane: cutting plane in the same frame F.
        min_share: minimum volume of a product, as a share of the mesh; if one is smaller, the plane only grazes.

    Returns:
        The products in F, or the reason why the plane does not divide the mesh. The order of the products depends
        only on the mesh and the plane.
    """
    distances = plane.distances(mesh.vertices)
    if distances.min() >= 0.0 or distances.max() <= 0.0:
        return Missed("the plane misses the fragment")
    normal = (float(plane.normal[0]), float(plane.normal[1]), float(plane.normal[2]))
    above, below = solid_of(mesh).split_by_plane(normal, -plane.offset)  # manifold3d writes n.v = d
    sides = (_components(above), _components(below))
    if not sides[0] or not sides[1]:
        return Missed("the plane grazes the fragment")
    if min(product.volume for side in sides for product in side) < min_share * mesh.volume:
        return Missed(f"the plane grazes the fragment: a product would be under {min_share:.1e} of its volume")
    return Sliced(*sides)


def _components(half: manifold3d.Manifold) -> tuple[Mesh, ...]:
    if half.is_empty():
        return ()
    parts = [mesh_of(part) for part in half.decompose()]
    if any(part.volume <= 0.0 for part in parts):  # the shell of an inner cavity is part of the half around it
        return (mesh_of(half),)
    return tuple(sorted(parts, key=lambda part: (-part.volume, *part.centroid)))
