"""Pictures for people, by casting rays: a light with shadows, and a sky.

SAPIEN's shader for such pictures needs 40 s before its first and then half a second for each, on a CPU whose Vulkan is
software; rays need half of that, nothing before the first, and no Vulkan at all. Whatever differs much from the pixel
beside it is painted four times, which smooths edges and softens shadows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.cameras.camera import Camera, Mask

Picture = NDArray[np.uint8]
"""(height, width, 3) red, green and blue."""

CREASE_DEG = 40.0
"""Triangles that meet at a smaller angle are shaded as one bent surface [degrees]."""
TABLE, TABLE_Z = (0.80, 0.80, 0.79), -0.05
"""Colour of what all stands on, and its height in W [m]."""
FAR = (0.93, 0.94, 0.95)
"""Colour that the table fades to, and of the sky."""
TOWARDS_LIGHT = np.array([0.45, -0.5, 1.0]) / np.linalg.norm([0.45, -0.5, 1.0])
SUN, SKY, BOUNCE = np.array([0.78, 0.76, 0.70]), np.array([0.40, 0.43, 0.47]), np.array([0.20, 0.18, 0.16])
"""Light of the lamp, and from above and below."""
ASIDE = ((-0.25, -0.1), (0.1, -0.25), (0.25, 0.1), (-0.1, 0.25))
"""Where a pixel is painted again, from its middle [pixels], and how the lamp is moved for it, times `LAMP`."""
LAMP = 0.15


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh as it is painted.

    Attributes:
        corners: (m, 3, 3) of its triangles, in its frame [m].
        normals: (m, 3, 3) at each of them.
        colours: (m, 3) of the triangles: red, green and blue from 0 to 1.
        gloss: how much it shines, from 0 to 1.
    """

    corners: Floats
    normals: Floats
    colours: Floats
    gloss: float


def body_of(mesh: Mesh, colours: Floats, gloss: float) -> Body:
    """A mesh to be painted in `colours`, (3,) or (m, 3) one a triangle."""
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    areas_n = np.cross(b - a, c - a)
    units = areas_n / np.maximum(np.linalg.norm(areas_n, axis=1, keepdims=True), 1e-300)
    normals = np.repeat(units[:, None], 3, axis=1)
    corner = mesh.faces.ravel()  # corner 3 i + k is that of triangle i
    order = np.argsort(corner, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(corner[order]) > 0, True])
    least = np.cos(np.radians(CREASE_DEG))
    flat = normals.reshape(-1, 3)
    for first, last in pairwise(starts):
        meeting = order[first:last]
        ours = meeting // 3
        together = (units[ours] @ units[ours].T > least) @ areas_n[ours]
        flat[meeting] = together / np.maximum(np.linalg.norm(together, axis=1, keepdims=True), 1e-300)
    return Body(mesh.triangles, normals, np.broadcast_to(colours, (len(mesh.faces), 3)), gloss)


def paint(camera: Camera, bodies: Sequence[tuple[Body, Pose]]) -> Picture:
    """What a camera sees of bodies in their poses X_WF, and of the table."""
    scene = _Scene(bodies)
    rays_W = camera.rays_W.reshape(-1, 3)
    once = scene.colours(camera.X_WC.position, rays_W, (0.0, 0.0))
    again = np.flatnonzero(_differs(once.reshape(camera.height, camera.width, 3)))
    right, down = camera.X_WC.rotation[:, 0] / camera.focal, camera.X_WC.rotation[:, 1] / camera.focal
    painted = [
        scene.colours(camera.X_WC.position, rays_W[again] + u * right + v * down, (LAMP * v, LAMP * u))
        for u, v in ASIDE
    ]
    once[again] = np.mean(painted, axis=0)
    shown = np.clip(once, 0.0, 1.0) ** (1.0 / 2.2)
    return np.asarray((255.0 * shown + 0.5).astype(np.uint8).reshape(camera.height, camera.width, 3))


def _differs(colours: Floats) -> Mask:
    differs = np.zeros(colours.shape[:2], dtype=np.bool_)
    down = np.abs(np.diff(colours, axis=0)).max(axis=2) > 0.03
    right = np.abs(np.diff(colours, axis=1)).max(axis=2) > 0.03
    differs[1:] |= down
    differs[:-1] |= down
    differs[:, 1:] |= right
    differs[:, :-1] |= right
    return differs


class _Scene:
    """Bodies in their places, with what is needed to paint what a ray meets."""

    def __init__(self, bodies: Sequence[tuple[Body, Pose]]) -> None:
        self._embree = EmbreeScene(robust=True)
        places = [X.apply(body.corners.reshape(-1, 3)).reshape(-1, 3, 3) for body, X in bodies]
        corners = np.concatenate([np.zeros((0, 3, 3)), *places])
        turned = [X.rotate(body.normals.reshape(-1, 3)).reshape(-1, 3, 3) for body, X in bodies]
        self._normals = np.concatenate([np.zeros((0, 3, 3)), *turned])
        self._colours = np.concatenate([np.zeros((0, 3)), *(body.colours**2.2 for body, _ in bodies)])
        self._gloss = np.concatenate([np.zeros(0), *(np.full(len(body.corners), body.gloss) for body, _ in bodies)])
        if len(corners):
            TriangleMesh(self._embree, np.ascontiguousarray(corners, dtype=np.float32))

    def colours(self, eye: Floats, rays: Floats, lamp: tuple[float, float]) -> Floats:
        """(n, 3) light, in linear units, along rays (n, 3) of any length from `eye` (3,)."""
        far = np.array(FAR) ** 2.2
        light = np.broadcast_to(far, rays.shape).copy()
        said = self._embree.run(
            np.broadcast_to(eye.astype(np.float32), rays.shape).copy(), rays.astype(np.float32), output=True
        )
        hit = said["geomID"] >= 0
        depth = np.where(hit, said["tfar"], np.inf)
        with np.errstate(divide="ignore"):
            to_table = (TABLE_Z - eye[2]) / rays[:, 2]
        table = (to_table > 0.0) & (to_table < depth)
        hit &= ~table
        triangle, u, v = said["primID"][hit], said["u"][hit], said["v"][hit]
        weights = np.stack([1.0 - u - v, u, v], axis=1)
        normals = np.einsum("ij,ijk->ik", weights, self._normals[triangle])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        flat = said["Ng"][hit].astype(np.float64)
        flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
        flat[np.einsum("ij,ij->i", flat, rays[hit]) > 0.0] *= -1.0
        normals[np.einsum("ij,ij->i", normals, flat) < 0.0] *= -1.0
        points = eye + depth[hit, None] * rays[hit]
        lit = self._lit(points, flat, normals, rays[hit], self._colours[triangle], self._gloss[triangle], lamp)
        light[hit] = lit
        where = eye + to_table[table, None] * rays[table]
        up = np.broadcast_to([0.0, 0.0, 1.0], where.shape)
        colour = np.broadcast_to(np.array(TABLE) ** 2.2, where.shape)
        lit = self._lit(where, up, up, rays[table], colour, np.zeros(len(where)), lamp)
        fades = np.clip((np.linalg.norm(where[:, :2], axis=1, keepdims=True) - 0.6) / 1.6, 0.0, 1.0)
        light[table] = (1.0 - fades) * lit + fades * far
        return light

    def _lit(
        self,
        points: Floats,
        flat: Floats,
        normals: Floats,
        rays: Floats,
        colours: Floats,
        gloss: Floats,
        lamp: tuple[float, float],
    ) -> Floats:
        towards = TOWARDS_LIGHT + np.array([*lamp, 0.0])
        towards = towards / np.linalg.norm(towards)
        facing = np.einsum("ij,j->i", normals, towards)
        asks = np.flatnonzero((facing > 0.0) & (flat @ towards > 0.0))
        falls = np.zeros(len(points))
        if len(asks):
            origins = (points[asks] + 1e-4 * flat[asks]).astype(np.float32)
            directions = np.broadcast_to(towards.astype(np.float32), origins.shape).copy()
            free = np.asarray(self._embree.run(origins, directions, query="OCCLUDED")) < 0
            falls[asks[free]] = facing[asks[free]]
        above = (0.5 + 0.5 * normals[:, 2])[:, None]
        light = colours * (falls[:, None] * SUN + above * SKY + (1.0 - above) * BOUNCE)
        half = towards - rays / np.linalg.norm(rays, axis=1, keepdims=True)
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = np.clip(np.einsum("ij,ij->i", normals, half), 0.0, 1.0) ** 60
        return np.asarray(light + (0.5 * gloss * shine * (falls > 0.0))[:, None])
