"""Reconstructions of fragments by a decoder: their overlap with the fragment, and their surface (III-D, IM-NET).

Shapes are in their canonical frames and divided by their scales, as for the decoder, so they lie in the cube [-1, 1].
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
"""A region: which of points (n, 3) are inside."""

POINTS = 4096
"""Number of sample points in each zone: the fragment's bounding box, close to it, and far from it."""
MARGIN = 0.15
"""Width of the zone close to the box."""
CELLS = 40
"""Number of cells along each side of the grid that is used to locate the surface."""
HALF_SIDE = 1.25
"""Half the side of the cube in which reconstructions are evaluated; the decoder is not trained outside."""


def reconstruction(decoder: Decoder, z_shape: Floats) -> Occupied:
    """The region in which the decoder's probability is above 0.5."""
    return lambda points: np.asarray(decoder(z_shape, points) > 0.5)


def overlap_with(mesh: Mesh, occupied: Occupied) -> float:
    """Intersection over union of a mesh and a region, by volume.

    Args:
        mesh: closed, within the cube [-1, 1].
        occupied: the region.

    Returns:
        From 0 to 1, with an error of about .01: it is estimated with low-discrepancy sequences in the mesh's box and in
        two zones around it, where any volume of the region is surplus.
    """
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    within = _samples(lowest, highest)
    truth, seen, box = inside(mesh, within), occupied(within), float(np.prod(highest - lowest))
    surplus = 0.0
    for margin, further in ((0.0, MARGIN), (MARGIN, 2.0 * HALF_SIDE)):
        outer = np.maximum(lowest - further, -HALF_SIDE), np.minimum(highest + further, HALF_SIDE)
        points = _samples(*outer)
        beyond = ((points < lowest - margin) | (points > highest + margin)).any(axis=1)
        surplus += float(np.prod(outer[1] - outer[0])) * np.count_nonzero(occupied(points[beyond])) / POINTS
    return float(box * np.mean(truth & seen) / (box * np.mean(truth | seen) + surplus))


def _samples(lowest: Floats, highest: Floats) -> Floats:
    return np.asarray(lowest + _unit_cube() * (highest - lowest))


@cache
def _unit_cube() -> Floats:
    return np.asarray(qmc.Halton(3, scramble=False).random(POINTS + 1)[1:])


def reconstructed(decoder: Decoder, z_shape: Floats, edge: float = 0.06) -> Mesh | None:
    """The surface of the reconstruction as a closed mesh; None if it is empty.

    Isolated parts smaller than a grid cell may be missing.

    Args:
        decoder: the decoder.
        z_shape: (shape_size,).
        edge: approximate edge length of the mesh.
    """

    def logit(x: float, y: float, z: float) -> float:
        p = float(decoder(z_shape, np.array([[x, y, z]]))[0])
        return float(np.log(max(p, 1e-12)) - np.log(max(1.0 - p, 1e-12)))

    step = 2.0 * HALF_SIDE / CELLS
    places = np.asarray(step * (np.indices((CELLS,) * 3).reshape(3, -1).T + 0.5) - HALF_SIDE, dtype=np.float64)
    found = places[reconstruction(decoder, z_shape)(places)]  # the surface is extracted only near these
    if not len(found):
        return None
    lowest, highest = found.min(axis=0) - 1.5 * step, found.max(axis=0) + 1.5 * step
    solid = manifold3d.Manifold.level_set(logit, (*lowest.tolist(), *highest.tolist()), edge)
    return None if solid.is_empty() else mesh_of(solid)
