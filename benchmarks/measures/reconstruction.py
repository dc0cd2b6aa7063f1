"""What a decoder makes of a shape feature: how far it overlaps with the fragment, and its surface (III-D, IM-NET).

Shapes are seen as the decoder sees them: in their canonical frames, divided by their scales, so that all of them lie
within the cube [-1, 1].
"""

from collections.abc import Callable
from functools import cache

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import mesh_of
from cutgrammar.perception.encoder import Decoder
from cutgrammar.perception.occupancy import inside

Occupied = Callable[[Floats], NDArray[np.bool_]]
"""Which of points (n, 3) lie inside something."""

POINTS = 4096
"""Points at which a fragment and a region are compared in each zone: the fragment's box, next to it, far from it."""
MARGIN = 0.15
"""How far the zone next to the box reaches."""
CELLS = 40
"""Cells along each side of the grid on which a surface is looked for first."""
REACH = 1.25
"""Half the side of the cube in which a reconstruction is looked at; beyond it nothing was learned."""


def reconstruction(decoder: Decoder, z_shape: Floats) -> Occupied:
    """What the decoder holds to be inside: where its probability is above a half."""
    return lambda points: np.asarray(decoder(z_shape, points) > 0.5)


def overlap_with(mesh: Mesh, occupied: Occupied) -> float:
    """Intersection over union of a mesh and a region, by volume.

    Args:
        mesh: closed, within the cube [-1, 1].
        occupied: the region.

    Returns:
        From 0 to 1, within about .01: a low-discrepancy sequence fills the mesh's box, and the two zones around it,
        where all that the region holds is too much.
    """
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    within = _filling(lowest, highest)
    truth, seen, box = inside(mesh, within), occupied(within), float(np.prod(highest - lowest))
    too_much = 0.0
    for margin, further in ((0.0, MARGIN), (MARGIN, 2.0 * REACH)):
        outer = np.maximum(lowest - further, -REACH), np.minimum(highest + further, REACH)
        points = _filling(*outer)
        beyond = ((points < lowest - margin) | (points > highest + margin)).any(axis=1)
        too_much += float(np.prod(outer[1] - outer[0])) * np.count_nonzero(occupied(points[beyond])) / POINTS
    return float(box * np.mean(truth & seen) / (box * np.mean(truth | seen) + too_much))


def _filling(lowest: Floats, highest: Floats) -> Floats:
    return np.asarray(lowest + _unit_cube() * (highest - lowest))


@cache
def _unit_cube() -> Floats:
    return np.asarray(qmc.Halton(3, scramble=False).random(POINTS + 1)[1:])


def reconstructed(decoder: Decoder, z_shape: Floats, edge: float = 0.06) -> Mesh | None:
    """The surface that the decoder holds to be the fragment's, as a closed mesh; None if it finds nothing inside.

    What is smaller than the cells of a grid and far from the rest may be left out.

    Args:
        decoder: asked whether points are inside.
        z_shape: (shape_size,).
        edge: about the length of the mesh's edges.
    """

    def logit(x: float, y: float, z: float) -> float:
        p = float(decoder(z_shape, np.array([[x, y, z]]))[0])
        return float(np.log(max(p, 1e-12)) - np.log(max(1.0 - p, 1e-12)))

    step = 2.0 * REACH / CELLS
    places = np.asarray(step * (np.indices((CELLS,) * 3).reshape(3, -1).T + 0.5) - REACH, dtype=np.float64)
    found = places[reconstruction(decoder, z_shape)(places)]  # the surface is then looked for near these alone
    if not len(found):
        return None
    lowest, highest = found.min(axis=0) - 1.5 * step, found.max(axis=0) + 1.5 * step
    solid = manifold3d.Manifold.level_set(logit, (*lowest.tolist(), *highest.tolist()), edge)
    return None if solid.is_empty() else mesh_of(solid)
