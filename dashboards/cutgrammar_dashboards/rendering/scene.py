"""The renderer: finds which surface each ray meets first, and computes how it is lit.

Drawings for figures and pages (`drawing`) and pictures of films (`painting`) both use it; they differ in their rays,
their light and their background.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.rays import RayCaster
from cutgrammar_dashboards.rendering.body import Body

SHADOW_BIAS = 1e-4
"""Shadow rays start this far above their surface, so that it does not shade itself [m]."""


@dataclass(frozen=True, eq=False)
class Light:
    """A distant lamp and the light of the surroundings.

    Attributes:
        towards: (3,) unit vector towards the lamp.
        lamp, above, below: (3,) colours of the lamp and of the light from above and from below.
        shininess: exponent of highlights.
        shadows: whether bodies cast shadows.
        gamma: exponent from stored colours to the units in which light adds up: 2.2 is physical; 1 keeps the colours
            of a palette.
    """

    towards: Floats
    lamp: Floats
    above: Floats
    below: Floats
    shininess: float
    shadows: bool
    gamma: float


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of surfaces.

    Attributes:
        points: (n, 3) [m].
        to_eye: (n, 3) unit vectors towards the eye.
        flat, normals: (n, 3) unit normals of the triangles and of the smooth surfaces, on the side of the eye.
        colours: (n, 3) from 0 to 1.
        gloss: (n,).
    """

    points: Floats
    to_eye: Floats
    flat: Floats
    normals: Floats
    colours: Floats
    gloss: Floats


class Scene:
    """Bodies in their places."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        corners = [body.vertices[body.faces] for body in bodies]
        sizes = [len(body.faces) for body in bodies]
        self._caster = RayCaster(np.concatenate([np.zeros((0, 3, 3)), *corners]))
        self._normals = np.concatenate([np.zeros((0, 3, 3)), *(body.normals[body.faces] for body in bodies)])
        colours = [np.broadcast_to(body.colours, (len(body.faces), 3)) for body in bodies]
        self._colours = np.concatenate([np.zeros((0, 3)), *colours])
        self._gloss = np.repeat([body.gloss for body in bodies], sizes)
        self._owner = np.repeat(np.arange(len(bodies)), sizes)

    def look(self, origins: Floats, directions: Floats) -> tuple[Ints, Floats, Surface]:
        """What rays with these origins (n, 3) or (3,) and directions (n, 3) of any length meet first.

        Returns:
            (n,) the body that each ray meets, -1 for none; (n,) distances in lengths of the directions, infinite for
            none; the surface where there is one.
        """
        hits = self._caster.first_hits(origins, directions)
        hit = hits.triangle >= 0
        triangle, rays = hits.triangle[hit], directions[hit]
        owner, distance = np.full(len(hit), -1), np.full(len(hit), np.inf)
        owner[hit], distance[hit] = self._owner[triangle], hits.distance[hit]
        second, third = hits.uv[hit].T.astype(np.float64)
        weights = np.stack([1.0 - second - third, second, third], axis=1)
        normals = _unit(np.einsum("ij,ijk->ik", weights, self._normals[triangle]))
        flat = _unit(hits.normals[hit].astype(np.float64))
        flat[_dot(flat, rays) > 0.0] *= -1.0
        normals[_dot(normals, flat) < 0.0] *= -1.0
        points = np.broadcast_to(origins, directions.shape)[hit] + distance[hit, None] * rays
        surface = Surface(points, -_unit(rays), flat, normals, self._colours[triangle], self._gloss[triangle])
        return owner, distance, surface

    def shade(self, surface: Surface, light: Light) -> Floats:
        """(n, 3) light, in the units in which it adds up, that surfaces send to the eye."""
        facing = surface.normals @ light.towards
        lit = (facing > 0.0) & (surface.flat @ light.towards > 0.0) if light.shadows else facing > 0.0
        if light.shadows and lit.any():
            origins = surface.points[lit] + SHADOW_BIAS * surface.flat[lit]
            lit[lit] = ~self._caster.blocked(origins, light.towards)
        diffuse = np.where(lit, facing, 0.0)[:, None]
        upward = (0.5 + 0.5 * surface.normals[:, 2])[:, None]
        halfway = _unit(light.towards + surface.to_eye)
        highlight = 0.5 * surface.gloss * np.clip(_dot(surface.normals, halfway), 0.0, 1.0) ** light.shininess * lit
        ambient = upward * light.above + (1.0 - upward) * light.below
        return np.asarray(surface.colours**light.gamma * (diffuse * light.lamp + ambient) + highlight[:, None])


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300))


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", a, b))


Pixels = NDArray[np.uint8]
"""(height, width, 3 or 4) red, green, blue and, of drawings, opacity, from 0 to 255."""
