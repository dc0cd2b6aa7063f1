"""What the terminals of a plan shall become: the goal's fragments as occupancy grids in their canonical frames.

The share of each cell that the solid fills is exact for meshes. Between the cells' centres it is interpolated; the
solid's surface is where the interpolated share is one half. That places flat faces exactly, where the plain shares
would blur them by a cell. A steep ramp about one half instead of a step keeps the overlap a smooth function of the
planes. The ramp is tabulated in cells `FINE` times as fine, so that one look-up tells whether a point is inside.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cutgrammar.fitting.interior_points import solid_of_shape
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame, covariance
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.fragment import Fragment, Mesh

HALF = 10
"""Cells on either side of the centroid along each axis."""
STEEPNESS = 4.0
"""Slope of the ramp from outside to inside, in occupancy per interpolated share."""
FINE = 4
"""Cells of the table of occupancies along each side of a cell of shares."""
SIDE = 2 * HALF * FINE + 2
"""Cells of the table along each axis, of which the outermost are empty."""
INSIDE = 255
"""The tabulated occupancy of a cell that is wholly inside."""


class Targets(NamedTuple):
    """The goal's fragments, prepared for overlaps with sample points.

    Attributes:
        grids: (g, SIDE**3) occupancies of the cells of the table, from 0 to `INSIDE`; the last axis runs fastest.
        cells: (g, 3) size of these cells along each axis of the canonical frame [m].
        deviations: (g, 3) standard deviations of the volume along the axes, ascending [m].
        volumes: (g,) [m3].
    """

    grids: NDArray[np.uint8]
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


def _target(solid: Mesh) -> tuple[NDArray[np.uint8], Floats, Floats]:
    """Grid, cells and deviations of one solid."""
    triangles = solid.moved(canonical_frame(solid).inverse()).triangles
    cells = np.abs(triangles).max(axis=(0, 1)) / HALF
    filled = cell_volumes(triangles, cells, HALF) / cells.prod()
    deviations = np.sqrt(np.linalg.eigvalsh(covariance(solid)).clip(0.0))
    return _occupancies(np.pad(filled.clip(0.0, 1.0), 1)), cells / FINE, deviations


@njit(cache=True)
def _occupancies(shares):  # type: ignore[no-untyped-def]
    """The table of occupancies from the shares of the cells filled, which have an empty layer around."""
    table = np.zeros(SIDE**3, np.uint8)
    # The centres of the table's cells, in cells of shares from the centre of the first.
    centres = 0.5 + (np.arange(SIDE) - 0.5) / FINE
    for a in range(1, SIDE - 1):
        i = int(centres[a])
        u = centres[a] - i
        sheet = (1.0 - u) * shares[i] + u * shares[i + 1]
        for b in range(1, SIDE - 1):
            j = int(centres[b])
            v = centres[b] - j
            row = (1.0 - v) * sheet[j] + v * sheet[j + 1]
            for c in range(1, SIDE - 1):
                k = int(centres[c])
                w = centres[c] - k
                occupancy = 0.5 + STEEPNESS * ((1.0 - w) * row[k] + w * row[k + 1] - 0.5)
                table[(a * SIDE + b) * SIDE + c] = int(INSIDE * min(max(occupancy, 0.0), 1.0) + 0.5)
    return table
