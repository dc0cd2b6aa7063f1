"""Depth images by casting rays, which needs no graphics driver.

Only pixels inside the bounding rectangles of the bodies' images cast rays; all others see the board, the plane z = 0.
"""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.camera import Camera
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.rays import RayCaster
from cutgrammar_sim.cameras.camera import BACKGROUND, OTHER, Image, Mask, board_depth

MIN_DEPTH = 0.01
"""Bodies with a vertex nearer than this to the pinhole's plane may be anywhere in the image [m]."""


class Rays:
    """A depth renderer that casts rays."""

    name = "rays"

    def images(self, cameras: Sequence[Camera], now: Configuration, others: Sequence[Mesh] = ()) -> list[Image]:
        """The images that the cameras take of the board, the fragments and `others`, whose frame is W.

        Raises:
            TypeError: a fragment is known as a point cloud only.
        """
        meshes = [fragment.mesh.moved(fragment.X_WF) for fragment in now] + list(others)
        owners = list(range(len(now))) + [OTHER] * len(others)
        caster = RayCaster(np.concatenate([np.zeros((0, 3, 3)), *(mesh.triangles for mesh in meshes)]))
        owner_of_triangle = np.repeat(np.array(owners, dtype=np.int64), [len(mesh.faces) for mesh in meshes])
        return [_image(camera, meshes, caster, owner_of_triangle) for camera in cameras]


def _image(camera: Camera, meshes: Sequence[Mesh], caster: RayCaster, owner_of_triangle: Ints) -> Image:
    depth = board_depth(camera).flatten()
    owner = np.full(depth.shape, BACKGROUND)
    cast = np.flatnonzero(_bounding_rectangles(camera, meshes))
    if len(cast):
        hits = caster.first_hits(camera.X_WC.position, camera.rays_W.reshape(-1, 3)[cast])
        hit = (hits.triangle >= 0) & ((hits.distance < depth[cast]) | (depth[cast] == 0.0))
        depth[cast[hit]] = hits.distance[hit]  # the rays have z = 1 in C, so their lengths are depths
        owner[cast[hit]] = owner_of_triangle[hits.triangle[hit]]
    shape = (camera.height, camera.width)
    return Image(depth.reshape(shape), owner.reshape(shape))


def _bounding_rectangles(camera: Camera, meshes: Sequence[Mesh]) -> Mask:
    """(height, width) whether a pixel lies in the bounding rectangle of the image of any mesh."""
    inside = np.zeros((camera.height, camera.width), dtype=bool)
    X_CW = camera.X_WC.inverse()
    for mesh in meshes:
        depths: Floats = X_CW.apply(mesh.vertices)[:, 2]
        if depths.min() < MIN_DEPTH:
            inside[:] = True
            continue
        pixels = camera.project(mesh.vertices)
        left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 1, 0)
        right, bottom = np.maximum(np.ceil(pixels.max(axis=0)).astype(int) + 1, 0)
        inside[top:bottom, left:right] = True
    return inside
