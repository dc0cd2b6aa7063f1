"""Where planes and configurations are shown."""

from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, vertices_of
from cutgrammar.geometry.plane import Plane


def corners_W(fragments: Sequence[Fragment]) -> Floats:
    """(n, 3) vertices or points of all fragments in W [m]."""
    return np.vstack([fragment.X_WF.apply(vertices_of(fragment.shape)) for fragment in fragments])


def quad(plane: Plane, fragments: Sequence[Fragment], margin: float = 1.25) -> Floats:
    """(4, 3) corners in W of a rectangle in the plane that covers the fragments, `margin` times their size."""
    points = corners_W(fragments)
    upright = np.eye(3)[int(np.argmin(np.abs(plane.normal)))]
    u = np.cross(plane.normal, upright)
    u /= np.linalg.norm(u)
    across = np.stack([u, np.cross(plane.normal, u)])
    low, high = (points @ across.T).min(axis=0), (points @ across.T).max(axis=0)
    middle, half = (low + high) / 2.0, margin * (high - low) / 2.0
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.asarray((middle + signs * half) @ across - plane.offset * plane.normal)


def aside(reached: Sequence[Fragment], goal: Configuration) -> Floats:
    """(3,) shift that puts the goal beside the result along y, with a gap as wide as the wider of the two."""
    a, b = corners_W(reached), corners_W(goal)
    gap = max(np.ptp(a[:, 1]), np.ptp(b[:, 1]))
    middle = (a.max(axis=0) + a.min(axis=0) - b.max(axis=0) - b.min(axis=0)) / 2.0
    return np.array([middle[0], a[:, 1].max() + gap - b[:, 1].min(), 0.0])
