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

from cutgrammar.fitting.interior_points import surface_of
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh

HALF = 10
"""Cells on either side of the centroid along each axis."""
STEEPNESS = 4.0
"""Slope of the ramp from outside to inside, in occupancy per interpolated share."""


class Targets(NamedTuple):
    """The goal's fragments, prepared for overlaps with sample points.

    Attributes:
        grids: (g, 2 HALF + 2, 2 HALF + 2, 2 HALF + 2) shares of the cells filled, with an empty layer around.
        cells: (g, 3) size of a cell along each axis of the canonical frame [m].
        volumes: (g,) [m3].
    """

    grids: NDArray[np.float32]
    cells: Floats
    volumes: Floats


def targets_of(goal: Sequence[Fragment]) -> Targets:
    """The targets of a goal; a cloud counts as its convex hull.

    Raises:
        ValueError: a fragment has no volume.
    """
    rows = [_target(fragment.shape) for fragment in goal]
    return Targets(
        np.array([row[0] for row in rows]), np.array([row[1] for row in rows]), np.array([r[2] for r in rows])
    )


def _target(shape: Mesh | Cloud) -> tuple[NDArray[np.float32], Floats, float]:
    X_CF = canonical_frame(shape).inverse()
    triangles = X_CF.apply(surface_of(shape).reshape(-1, 3)).reshape(-1, 3, 3)
    cells = np.abs(triangles).max(axis=(0, 1)) / HALF
    filled = cell_volumes(triangles, cells, HALF) / cells.prod()
    return np.pad(filled.clip(0.0, 1.0), 1).astype(np.float32), cells, shape.volume
