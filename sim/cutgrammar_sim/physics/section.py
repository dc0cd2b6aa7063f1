"""The section in which a cutting plane meets a fragment."""

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane

BRUSH = 0.5e-3
"""Depth to which the blade may enter the board or another fragment [m]."""


def section(fragment: Fragment, plane_W: Plane) -> Floats:
    """(m, 2, 3) segments in W in which the plane meets the fragment's triangles [m]; m = 0 if it misses them."""
    triangles = fragment.X_WF.apply(fragment.mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    distances = plane_W.distances(triangles.reshape(-1, 3)).reshape(-1, 3)
    above = distances >= 0.0
    crossing = above.any(axis=1) & ~above.all(axis=1)
    triangles, distances, above = triangles[crossing], distances[crossing], above[crossing]
    # Rotate each triangle so that its first corner is alone on its side; both edges from it are crossed.
    lone_is_above = above.sum(axis=1) == 1
    turn = (np.argmax(above == lone_is_above[:, None], axis=1)[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(triangles, turn[:, :, None], axis=1)
    heights = np.take_along_axis(distances, turn, axis=1)
    share = heights[:, :1] / (heights[:, :1] - heights[:, 1:])
    return np.asarray(corners[:, :1] + share[:, :, None] * (corners[:, 1:] - corners[:, :1]))
