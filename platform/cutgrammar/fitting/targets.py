"""What the terminals of a plan shall become: the goal's fragments as occupancy grids in their canonical frames.

A grid holds the share of each cell that the solid fills, exact for meshes. Between the cells' centres it is
interpolated; the solid's surface is where the interpolated share is one half. That places flat faces exactly, where
the plain shares would blur them by a cell. A steep ramp about one half instead of a step keeps the overlap a smooth
function of the planes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutgrammar.fitting.interior_points import solid_of_shape
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame, covariance
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.fragment import Fragment, Mesh

HALF = 10
"""Cells on either side of the centroid along each axis."""
SIDE = 2 * HALF + 2
"""Cells along each axis, with an empty layer around."""
STEEPNESS = 4.0
"""Slope of the ramp from outside to inside, in occupancy per interpolated share."""


class Targets(NamedTuple):
    """The goal's fragments, prepared for overlaps with sample points.

    Attributes:
        grids: (g, SIDE, SIDE, SIDE) shares of the cells filled.
        cells: (g, 3) size of a cell along each axis of the canonical frame [m].
        deviations: (g, 3) standard deviations of the volume along the axes, ascending [m].
        volumes: (g,) [m3].
    """

    grids: NDArray[np.float32]
    cells: Floats
    deviations: Floats
    volumes: Floats


def targets_of(goal: Sequence[Fragment]) -> Targets:
    """The targets of a goal; a cloud counts as its convex hull.

    Raises:
        ValueError: a fragment has no volume.
    """
    solids = [solid_of_shape(fragment.shape) for fragment in goal]
    grids, cells, deviations = zip(*(_target(solid) for solid in solids), strict=True)
    return Targets(np.array(grids), np.array(cells), np.array(deviations), np.array([solid.volume for solid in solids]))


def _target(solid: Mesh) -> tuple[NDArray[np.float32], Floats, Floats]:
    """Grid, cells and deviations of one solid."""
    triangles = solid.moved(canonical_frame(solid).inverse()).triangles
    cells = np.abs(triangles).max(axis=(0, 1)) / HALF
    filled = cell_volumes(triangles, cells, HALF) / cells.prod()
    deviations = np.sqrt(np.linalg.eigvalsh(covariance(solid)).clip(0.0))
    return np.pad(filled.clip(0.0, 1.0), 1).astype(np.float32), cells, deviations
