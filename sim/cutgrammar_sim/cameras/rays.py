"""Depth images by casting rays with Embree: no graphics driver is needed.

Only the pixels within the fragments' outlines, as rectangles, cast rays; all others see the board, the plane z = 0.
"""

from collections.abc import Sequence

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar_sim.cameras.camera import BACKGROUND, OTHER, Camera, Image, Mask


class Rays:
    """A renderer that casts rays."""

    name = "rays"

    def images(self, cameras: Sequence[Camera], now: Configuration, others: Sequence[Mesh] = ()) -> list[Image]:
        """What each camera images of the board, the fragments and `others`, whose frame is W.

        Raises:
            TypeError: a fragment is known as a point cloud only.
        """
        meshes = [fragment.mesh.moved(fragment.X_WF) for fragment in now] + list(others)
        owners = list(range(len(now))) + [OTHER] * len(others)
        scene, owner_of = EmbreeScene(robust=True), np.zeros(0, dtype=np.int64)
        if meshes:
            triangles = np.concatenate([mesh.triangles for mesh in meshes])
            TriangleMesh(scene, np.ascontiguousarray(triangles, dtype=np.float32))
            owner_of = np.repeat(np.array(owners), [len(mesh.faces) for mesh in meshes])
        return [_image(camera, meshes, scene, owner_of) for camera in cameras]


def _image(camera: Camera, meshes: Sequence[Mesh], scene: EmbreeScene, owner_of: Ints) -> Image:
    rays_W = camera.rays_W.reshape(-1, 3)
    depth = camera.board.flatten()
    owner = np.full(depth.shape, BACKGROUND)
    cast = np.flatnonzero(_outlines(camera, meshes))
    if len(cast):
        directions = np.ascontiguousarray(rays_W[cast], dtype=np.float32)
        origins = np.broadcast_to(camera.X_WC.position.astype(np.float32), directions.shape).copy()
        said = scene.run(origins, directions, output=True)
        hit = (said["geomID"] >= 0) & ((said["tfar"] < depth[cast]) | (depth[cast] == 0.0))
        depth[cast[hit]] = said["tfar"][hit]  # the rays have z = 1 in C, so what is given in their lengths is depth
        owner[cast[hit]] = owner_of[said["primID"][hit]]
    shape = (camera.height, camera.width)
    return Image(depth.reshape(shape), owner.reshape(shape))


def _outlines(camera: Camera, meshes: Sequence[Mesh]) -> Mask:
    """(height, width) whether a pixel lies in the rectangle about the image of a mesh."""
    within = np.zeros((camera.height, camera.width), dtype=bool)
    X_CW = camera.X_WC.inverse()
    for mesh in meshes:
        before: Floats = X_CW.apply(mesh.vertices)[:, 2]
        if before.min() < 0.01:  # at or behind the pinhole: it may be anywhere in the image
            within[:] = True
            continue
        places = camera.project(mesh.vertices)
        left, top = np.maximum(np.floor(places.min(axis=0)).astype(int) - 1, 0)
        right, bottom = np.maximum(np.ceil(places.max(axis=0)).astype(int) + 1, 0)
        within[top:bottom, left:right] = True
    return within
