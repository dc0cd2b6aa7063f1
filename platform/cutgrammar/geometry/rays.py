"""Rays cast against triangles by Embree: depth cameras and pictures for people share this module."""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class Hits:
    """The first triangle that each of n rays hits, in single precision.

    Attributes:
        triangle: (n,) index of the triangle; -1 where a ray hits nothing.
        distance: (n,) from the origin, in lengths of the ray's direction.
        uv: (n, 2) barycentric weights of the triangle's second and third corner.
        normals: (n, 3) normals of the triangles, of any length, counter-clockwise side out.
    """

    triangle: Ints
    distance: NDArray[np.float32]
    uv: NDArray[np.float32]
    normals: NDArray[np.float32]


class RayCaster:
    """Triangles (m, 3, 3), in any frame, that rays are cast against."""

    def __init__(self, triangles: Floats) -> None:
        self._scene = EmbreeScene(robust=True)
        if len(triangles):
            TriangleMesh(self._scene, np.ascontiguousarray(triangles, dtype=np.float32))

    def first_hits(self, origins: Floats, directions: Floats) -> Hits:
        """The first hits of rays with these origins (n, 3) or (3,) and directions (n, 3) of any length."""
        found = self._scene.run(*_single_precision(origins, directions), output=True)
        triangle = np.where(found["geomID"] >= 0, found["primID"], -1)
        return Hits(triangle, found["tfar"], np.stack([found["u"], found["v"]], axis=1), found["Ng"])

    def blocked(self, origins: Floats, directions: Floats) -> NDArray[np.bool_]:
        """(n,) whether rays with these origins (n, 3) and directions (n, 3) or (3,) hit anything."""
        return np.asarray(self._scene.run(*_single_precision(origins, directions), query="OCCLUDED") >= 0)


def _single_precision(origins: Floats, directions: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Both as arrays (n, 3) of their own, as Embree wants them."""
    start, end = np.broadcast_arrays(origins.astype(np.float32), directions.astype(np.float32))
    return np.ascontiguousarray(start).copy(), np.ascontiguousarray(end).copy()
