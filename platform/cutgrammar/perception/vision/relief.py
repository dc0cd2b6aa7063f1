"""The relief of a cloud: how far each point lies above or below the smooth surface through its neighbours.

The smooth surface is the quadric that fits best, by iteratively reweighted least squares with Cauchy weights, so that
a narrow valley does not bend it. Neighbours whose normals differ much, such as those around an edge, are left out.
"""

import numpy as np
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats

RADIUS = 0.012
"""Neighbours are searched within this distance [m]."""
MAX_NEIGHBOURS, MIN_NEIGHBOURS = 96, 20
"""Maximum number of neighbours of a point, and minimum number with which its relief is known."""
SAME_SIDE = 0.6
"""Minimum cosine between the normals of a point and its neighbours."""
ROUNDS, SCALE = 3, 6e-4
"""Number of fits, and the residual that halves a point's weight [m]."""


def relief(points: Floats, normals: Floats) -> Floats:
    """(n,) heights of points (n, 3) with normals (n, 3) above the surface around them [m]; NaN if not known."""
    distances, neighbours = cKDTree(points).query(points, k=min(MAX_NEIGHBOURS, len(points)))
    cosines = np.einsum("nkj,nj->nk", normals[neighbours], normals)
    used = ((distances < RADIUS) & (cosines > SAME_SIDE)).astype(np.float64)
    normal = np.einsum("nkj,nk->nj", normals[neighbours], used)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    u = np.cross(normal, np.where(np.abs(normal[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-9)
    offsets = points[neighbours] - points[:, None]
    x, y, z = (np.einsum("nkj,nj->nk", offsets, axis) for axis in (u, np.cross(normal, u), normal))
    x, y = x / RADIUS, y / RADIUS
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
    weights, fitted = used, np.zeros((len(points), 6, 1))
    for _ in range(ROUNDS):
        weighted = (terms * weights[:, :, None]).transpose(0, 2, 1)
        matrices = np.matmul(weighted, terms) + 1e-6 * np.eye(6)
        fitted = np.linalg.solve(matrices, np.matmul(weighted, z[:, :, None]))
        residuals = z - np.matmul(terms, fitted)[:, :, 0]
        weights = used / (1.0 + np.square(residuals / SCALE))
    return np.where(used.sum(axis=1) < MIN_NEIGHBOURS, np.nan, -fitted[:, 0, 0])
