"""Drawings of bodies for figures and pages: orthographic, on a transparent ground, with lines along edges.

The eye is infinitely far away, so sizes can be compared. A drawing is a pure function of its bodies: it needs no window
and no graphics driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar_dashboards.rendering.body import Body
from cutgrammar_dashboards.rendering.scene import Light, Pixels, Scene

SAMPLES = 2
"""Rays along each side of a pixel."""
LIGHT = Light(
    towards=np.array([-0.35, -0.55, 0.85]) / np.linalg.norm([-0.35, -0.55, 0.85]),
    lamp=np.full(3, 0.40),
    above=np.full(3, 0.70),
    below=np.full(3, 0.50),
    shininess=24.0,
    shadows=False,
)
MIN_COSINE = 0.82
"""A line is drawn between neighbouring samples whose normals have a smaller cosine between them."""
OUTLINE, EDGE = 0.42, 0.72
"""Brightness of lines around bodies, and along edges within one."""
MARGIN = 1.5
"""Empty margin around a drawing [pixels]."""


@dataclass(frozen=True, eq=False)
class Eye:
    """The direction from which a drawing is seen.

    Attributes:
        towards: (3,) unit vector from the bodies to the eye.
    """

    towards: Floats

    @property
    def axes(self) -> Floats:
        """(2, 3) unit vectors to the right and upwards in the picture; z of the world points upwards."""
        right = np.cross([0.0, 0.0, 1.0], self.towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(self.towards, right)])


def eye_towards(*towards: float) -> Eye:
    """The eye in the direction of the vector (x, y, z)."""
    return Eye(np.array(towards) / np.linalg.norm(towards))


FRONT = eye_towards(0.45, -0.75, 0.62)
"""The board from the front, a little from the right and from above."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """Pixels and their place in the world.

    Attributes:
        pixels: (h, w, 4) with opacity.
        density: pixels a metre.
        corner: (2,) coordinates of the upper left corner along the eye's axes [m].
        eye: that sees them.
    """

    pixels: Pixels
    density: float
    corner: Floats
    eye: Eye

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.pixels.shape[1] / self.density, self.pixels.shape[0] / self.density

    def locate(self, p_W: Floats) -> Floats:
        """(n, 2) where points (n, 3) [m] are seen, as shares of the width from the left and the height from the top."""
        seen = (np.atleast_2d(p_W) @ self.eye.axes.T - self.corner) * [1.0, -1.0]
        return np.asarray(seen / self.size)


def draw(bodies: Sequence[Body], eye: Eye, density: float) -> Drawing:
    """The drawing of bodies, with a narrow margin.

    Args:
        bodies: in the world frame.
        eye: that sees them.
        density: pixels a metre.

    Raises:
        ValueError: no bodies.
    """
    if not bodies:
        raise ValueError("there is nothing to show")
    vertices = np.concatenate([body.vertices for body in bodies])
    seen, nearness = vertices @ eye.axes.T, vertices @ eye.towards
    upper_left = np.array([seen[:, 0].min() - MARGIN / density, seen[:, 1].max() + MARGIN / density])
    width, height = np.ceil(np.ptp(seen, axis=0) * density + 2.0 * MARGIN).astype(int)
    step = 1.0 / (SAMPLES * density)
    shape = height * SAMPLES, width * SAMPLES
    right = upper_left[0] + (np.arange(shape[1]) + 0.5) * step
    up = upper_left[1] - (np.arange(shape[0]) + 0.5) * step
    across = np.stack(np.meshgrid(right, up), axis=-1).reshape(-1, 2)
    origins = across @ eye.axes + (nearness.max() + step) * eye.towards
    scene = Scene(bodies)
    owner, distance, surface = scene.look(origins, np.broadcast_to(-eye.towards, origins.shape))
    hit = np.flatnonzero(owner >= 0)
    normals = np.zeros((len(owner), 3))
    normals[hit] = surface.normals
    lines = _lines(owner.reshape(shape), distance.reshape(shape), normals.reshape(*shape, 3), eye, step)
    rgba = np.zeros((len(owner), 4))
    rgba[hit, :3] = np.clip(scene.shade(surface, LIGHT) * lines.ravel()[hit, None], 0.0, 1.0)
    rgba[hit, 3] = 1.0
    rgba = rgba.reshape(height, SAMPLES, width, SAMPLES, 4).mean(axis=(1, 3))
    opacity = rgba[..., 3:]
    rgba[..., :3] = np.divide(rgba[..., :3], opacity, out=np.zeros_like(rgba[..., :3]), where=opacity > 0.0)
    return Drawing((255.0 * rgba).round().astype(np.uint8), density, upper_left, eye)


def _lines(owner: Ints, distance: Floats, normals: Floats, eye: Eye, step: float) -> Floats:
    """(h, w) brightness of samples: darker along outlines, a little darker along edges.

    Args:
        owner, distance, normals: (h, w), (h, w), (h, w, 3) of the body that each sample shows.
        eye: that sees them.
        step: distance between samples [m].
    """
    facing = np.clip(normals @ eye.towards, 0.1, 1.0)
    slope = np.where(owner >= 0, step * np.sqrt(1.0 - facing**2) / facing, np.inf)
    depth = np.where(owner >= 0, distance, 0.0)
    outline, edge = np.zeros(owner.shape, dtype=bool), np.zeros(owner.shape, dtype=bool)
    for axis in (0, 1):
        first, second = [slice(None)] * 2, [slice(None)] * 2
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        a, b = tuple(first), tuple(second)
        apart = owner[a] != owner[b]
        apart |= np.abs(depth[a] - depth[b]) > 4.0 * step + 2.0 * np.maximum(slope[a], slope[b])
        bent = np.einsum("ijk,ijk->ij", normals[a], normals[b]) < MIN_COSINE
        for side in (a, b):
            outline[side] |= apart
            edge[side] |= bent & ~apart
    return np.where(outline, OUTLINE, np.where(edge, EDGE, 1.0))
