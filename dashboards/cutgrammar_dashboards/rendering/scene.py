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
from cutgrammar_dashboards.rendering.light_kernels import reflected, surfaces_at

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
    """

    towards: Floats
    lamp: Floats
    above: Floats
    below: Floats
    shininess: float
    shadows: bool


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of surfaces.

    Attributes:
        points: (n, 3) [m].
        to_eye: (n, 3) unit vectors towards the eye.
        flat, normals: (n, 3) unit normals of the triangles and of the smooth surfaces, on the side of the eye.
        colours: (n, 3) from 0 to 1, in the units in which light adds up.
        gloss: (n,).
    """

    points: Floats
    to_eye: Floats
    flat: Floats
    normals: Floats
    colours: Floats
    gloss: Floats


class Scene:
    """Bodies in their places.

    Args:
        bodies: in the frame of the picture.
        gamma: exponent from their colours to the units in which light adds up: 2.2 is physical; 1 keeps the colours of
            a palette.
    """

    def __init__(self, bodies: Sequence[Body], gamma: float = 1.0) -> None:
        corners = [body.vertices[body.faces] for body in bodies]
        sizes = [len(body.faces) for body in bodies]
        self._caster = RayCaster(np.concatenate([np.zeros((0, 3, 3)), *corners]))
        self._normals = np.concatenate([np.zeros((0, 3, 3)), *(body.normals[body.faces] for body in bodies)])
        colours = [np.broadcast_to(body.colours**gamma, (len(body.faces), 3)) for body in bodies]
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
        rays = np.flatnonzero(hits.triangle >= 0)
        triangle = hits.triangle[rays]
        owner, distance = np.full(len(directions), -1), np.full(len(directions), np.inf)
        owner[rays], distance[rays] = self._owner[triangle], hits.distance[rays]
        points, to_eye, flat, normals = surfaces_at(
            rays,
            origins.reshape(-1, 3),
            directions,
            hits.distance,
            hits.uv,
            hits.normals,
            self._normals[triangle],
        )
        return owner, distance, Surface(points, to_eye, flat, normals, self._colours[triangle], self._gloss[triangle])

    def shade(self, surface: Surface, light: Light) -> Floats:
        """(n, 3) light, in the units in which it adds up, that surfaces send to the eye."""
        lit = surface.normals @ light.towards > 0.0
        if light.shadows:
            lit &= surface.flat @ light.towards > 0.0
            origins = surface.points[lit] + SHADOW_BIAS * surface.flat[lit]
            lit[lit] = ~self._caster.blocked(origins, light.towards)
        colours = (light.lamp, light.above, light.below)
        seen = (surface.normals, surface.to_eye, surface.colours, surface.gloss)
        return np.asarray(reflected(*seen, lit, light.towards, *colours, light.shininess))


Pixels = NDArray[np.uint8]
"""(height, width, 3 or 4) red, green, blue and, of drawings, opacity, from 0 to 255."""
