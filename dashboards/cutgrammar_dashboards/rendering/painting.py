"""Pictures of bodies as a camera sees them, for films: on a table, lit by a lamp with shadows and by the sky.

SAPIEN's shader for such pictures takes 40 s before the first one and half a second for each on a CPU with a software
Vulkan driver; casting rays takes half of that and needs no Vulkan. Pixels that differ from a neighbour are sampled four
times, which smooths edges and softens shadows. Where fragments touch, their seam is drawn: fragments of one colour that
an arm has pressed together would look like one.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.camera import Camera
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.light_kernels import contrasting
from cutgrammar_dashboards.rendering.scene import Light, Pixels, Scene, Surface

GAMMA = 2.2
"""Exponent from the colours of a picture to the units in which light adds up."""
TABLE, TABLE_Z = np.array([0.80, 0.80, 0.79]) ** GAMMA, -0.05
"""Colour of the table, in these units, and its height in W [m]."""
SKY = np.array([0.93, 0.94, 0.95]) ** GAMMA
"""Colour of the sky, to which the table fades."""
FADE = (0.6, 2.2)
"""Distances from the origin at which the table begins and ends to fade [m]."""
LIGHT = Light(
    towards=np.array([0.45, -0.5, 1.0]) / np.linalg.norm([0.45, -0.5, 1.0]),
    lamp=np.array([0.78, 0.76, 0.70]),
    above=np.array([0.40, 0.43, 0.47]),
    below=np.array([0.20, 0.18, 0.16]),
    shininess=60.0,
    shadows=True,
)
OFFSETS = ((-0.25, -0.1), (0.1, -0.25), (0.25, 0.1), (-0.1, 0.25))
"""Where a pixel is sampled again, from its middle [pixels]."""
LAMP_RADIUS = 0.15
"""The lamp moves by this times the swapped offset from sample to sample, which softens shadows."""
PIXELS = (255.0 * np.linspace(0.0, 1.0, 1 << 20) ** (1.0 / GAMMA) + 0.5).astype(np.uint8)
"""The pixels of equidistant amounts of light from 0 to 1; computing powers would take a fifth of a picture's time."""
AT_ONCE = 1 << 15
"""Rays that are followed at once; what is computed of so many stays in a processor's cache."""
CONTRAST = 0.03
"""A pixel that differs from a neighbour by more than this in a colour is sampled again."""
SEAM, SEAM_GAP = 0.3, 0.003
"""The light that is left along seams, as a share, and how far apart surfaces beside a seam are at most [m]."""


def paint(camera: Camera, bodies: Sequence[Body], fragments: slice = slice(0)) -> Pixels:
    """The picture that a camera takes of bodies and of the table.

    Args:
        camera: in the world frame.
        bodies: in the world frame.
        fragments: those of `bodies` between which seams are drawn; none if not given.

    Returns:
        (height, width, 3) pixels.
    """
    scene = Scene(bodies, GAMMA)
    shape = camera.height, camera.width, 3
    rays_W = camera.rays_W.reshape(-1, 3)
    light, owner, points = _light_along(scene, camera, rays_W, LIGHT)
    again = np.flatnonzero(contrasting(light.reshape(shape), CONTRAST))
    right, down = camera.X_WC.rotation[:, 0] / camera.focal, camera.X_WC.rotation[:, 1] / camera.focal
    samples = []
    for u, v in OFFSETS:
        lamp = _moved(LIGHT, LAMP_RADIUS * v, LAMP_RADIUS * u)
        samples.append(_light_along(scene, camera, rays_W[again] + (u * right + v * down), lamp)[0])
    light[again] = sum(samples) / len(samples)
    is_fragment = np.zeros(len(bodies) + 1, dtype=bool)  # the last is for no body
    is_fragment[fragments] = True
    light[_seams(np.where(is_fragment[owner], owner, -1).reshape(shape[:2]), points.reshape(shape)).ravel()] *= SEAM
    return PIXELS[(np.clip(light, 0.0, 1.0) * (len(PIXELS) - 1)).astype(np.intp)].reshape(shape)


def _moved(light: Light, x: float, y: float) -> Light:
    towards = light.towards + np.array([x, y, 0.0])
    return replace(light, towards=towards / np.linalg.norm(towards))


def _seams(owner: Ints, points: Floats) -> NDArray[np.bool_]:
    """(h, w) whether another fragment touches the one of a pixel to the right of it or below.

    Args:
        owner: (h, w) the fragment that each pixel shows, -1 for none.
        points: (h, w, 3) where [m].
    """
    found = np.zeros(owner.shape, dtype=bool)
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        seam = (owner[a] != owner[b]) & (owner[a] >= 0) & (owner[b] >= 0)
        seam[seam] = np.linalg.norm(points[a][seam] - points[b][seam], axis=1) < SEAM_GAP
        found[a] |= seam
    return found


def _light_along(scene: Scene, camera: Camera, rays: Floats, light: Light) -> tuple[Floats, Ints, Floats]:
    """What is seen along rays (n, 3) of any length from the camera.

    Returns:
        (n, 3) light in linear units; (n,) the body that is seen, -1 for none; (n, 3) where [m], if it is a body.
    """
    parts = [_light_along_some(scene, camera, rays[i : i + AT_ONCE], light) for i in range(0, len(rays), AT_ONCE)]
    nothing = np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    lights, owners, points = (np.concatenate(of_all) for of_all in zip(nothing, *parts, strict=True))
    return lights, owners, points


def _light_along_some(scene: Scene, camera: Camera, rays: Floats, light: Light) -> tuple[Floats, Ints, Floats]:
    eye = camera.X_WC.position
    owner, distance, surface = scene.look(eye, rays)
    with np.errstate(divide="ignore"):
        to_table = (TABLE_Z - eye[2]) / rays[:, 2]
    table = (to_table > 0.0) & (to_table < distance)
    result = np.broadcast_to(SKY, rays.shape).copy()
    result[owner >= 0] = scene.shade(surface, light)
    points = eye + to_table[table, None] * rays[table]
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    plane = Surface(points, up, up, up, np.broadcast_to(TABLE, points.shape), np.zeros(len(points)))
    away = np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    fade = np.clip((away - FADE[0]) / (FADE[1] - FADE[0]), 0.0, 1.0)
    result[table] = (1.0 - fade) * scene.shade(plane, light) + fade * SKY
    return result, owner, eye + np.where(owner >= 0, distance, 0.0)[:, None] * rays
