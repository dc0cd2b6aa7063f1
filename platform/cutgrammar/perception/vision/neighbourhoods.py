"""Features of the points of a fused cloud and of the edges between them: the input of the segmentation.

The cloud is first thinned to the mean of the points in each cell of a grid, which also reduces noise. Every point is
then described by its neighbours at three scales. All features are lengths, angles and heights above the board. They do
not depend on the order of the points or, apart from the grid, on rotations about the vertical and shifts along the
board.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats, Ints

CELL = 2.5e-3
"""Side length of the grid cells [m]."""
SCALES = (10, 24, 64)
"""Numbers of nearest neighbours in the descriptions of a point."""
N_EDGES = 10
"""Number of edges from a point to its nearest neighbours, and to farther ones up to the last scale."""
RADIUS = 0.012
"""Neighbours at a larger distance are ignored [m]."""
MAX_EDGE_LENGTH = 0.008
"""Longer edges are not used for grouping [m]."""


@dataclass(frozen=True, eq=False)
class Thinned:
    """A thinned cloud.

    Attributes:
        points, normals: (m, 3) means over the cells, in W [m].
        cell_of: (n,) index of the thinned point that represents each point of the cloud.
    """

    points: Floats
    normals: Floats
    cell_of: Ints


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """Features of points and edges.

    Attributes:
        points: (m, `POINT_FEATURES`) features of the points.
        near: (m, `N_EDGES`) indices of the nearest points; the point itself replaces missing neighbours.
        near_edges: (m, `N_EDGES`, `EDGE_FEATURES`) features of the edges to them.
        far: (m, `N_EDGES`) indices of some farther points.
        far_edges: (m, `N_EDGES`, `EDGE_FEATURES`) features of the edges to them.
        lengths: (m, `N_EDGES`) lengths of the edges to the nearest points [m]; infinite for missing neighbours.
    """

    points: Floats
    near: Ints
    near_edges: Floats
    far: Ints
    far_edges: Floats
    lengths: Floats


POINT_FEATURES = 2 + 6 * len(SCALES)
EDGE_FEATURES = 5 + 3 * len(SCALES)


def thin(points: Floats, normals: Floats, cell: float = CELL) -> Thinned:
    """One point for every non-empty cell of a grid in W; the result does not depend on the order of points (n, 3)."""
    order = np.lexsort(points.T)  # a fixed order of summation, for identical results
    cells = np.floor(points[order] / cell).astype(np.int64)
    _, sorted_cell_of, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sorted_cell_of = sorted_cell_of.ravel()
    cell_of = np.empty(len(points), dtype=np.int64)
    cell_of[order] = sorted_cell_of

    def sums(values: Floats) -> Floats:
        return np.stack([np.bincount(sorted_cell_of, values[order, k], len(count)) for k in range(3)], axis=1)

    mean_normals = sums(normals)
    lengths = np.linalg.norm(mean_normals, axis=1, keepdims=True)
    return Thinned(sums(points) / count[:, None], mean_normals / np.maximum(lengths, 1e-9), cell_of)


def describe(points: Floats, normals: Floats) -> Neighbourhoods:
    """Compute the features of points (m, 3) with normals (m, 3) and of their edges."""
    distances, neighbours = _nearest(points, SCALES[-1])
    offsets = points[neighbours] - points[:, None]
    within_radius = (distances <= RADIUS).astype(np.float64)
    features = [normals[:, 2], np.minimum(points[:, 2] / 0.02, 3.0)]
    sideways, mean_normals = [], []
    for scale in SCALES:
        weight = within_radius[:, :scale, None]
        count = np.maximum(weight.sum(axis=1), 1.0)
        weighted = offsets[:, :scale] * weight
        middle = weighted.sum(axis=1) / count
        spread = np.matmul(weighted.transpose(0, 2, 1), weighted) / count[:, :, None]
        spread -= middle[:, :, None] * middle[:, None, :]
        variances = np.linalg.eigvalsh(spread)
        total = np.maximum(variances.sum(axis=1), 1e-12)
        radius = np.sqrt(total)
        out = np.einsum("ij,ij->i", middle, normals)
        side = middle - out[:, None] * normals
        mean_normal = (normals[neighbours[:, :scale]] * weight).sum(axis=1) / count
        features += [
            variances[:, 0] / total,
            variances[:, 1] / total,
            out / radius,
            np.linalg.norm(side, axis=1) / radius,
            200.0 * radius,
            np.einsum("ij,ij->i", mean_normal, normals),
        ]
        sideways.append(side / radius[:, None])
        mean_normals.append(mean_normal)
    near, far = neighbours[:, :N_EDGES], neighbours[:, N_EDGES :: (SCALES[-1] - N_EDGES) // N_EDGES][:, :N_EDGES]
    near_edges, far_edges = (_edges(points, normals, others, sideways, mean_normals) for others in (near, far))
    return Neighbourhoods(np.stack(features, axis=1), near, near_edges, far, far_edges, distances[:, :N_EDGES])


def _edges(points: Floats, normals: Floats, others: Ints, sideways: list[Floats], mean_normals: list[Floats]) -> Floats:
    """(m, k, `EDGE_FEATURES`) features of the edges from each point to `others` (m, k)."""
    along = points[others] - points[:, None]
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-6)
    towards = along / length[..., None]

    def both(at: Floats) -> tuple[Floats, Floats]:
        """Cosines between the edge and directions (m, 3) at either end, each towards the other end."""
        return np.einsum("mkj,mj->mk", towards, at), -np.einsum("mkj,mkj->mk", towards, at[others])

    features = [
        np.minimum(length / CELL, 8.0) / 2.0,
        along[..., 2] / CELL / 2.0,
        np.einsum("mj,mkj->mk", normals, normals[others]),
        *both(normals),
    ]
    for side, mean_normal in zip(sideways, mean_normals, strict=True):
        features += [*both(side), np.einsum("mj,mkj->mk", mean_normal, mean_normal[others])]
    return np.stack(features, axis=2)


def _nearest(points: Floats, count: int) -> tuple[Floats, Ints]:
    """(m, count) distances and indices of the nearest other points; missing ones are the point itself at infinity."""
    distances, neighbours = cKDTree(points).query(points, k=min(count, len(points) - 1) + 1)
    distances, neighbours = distances.reshape(len(points), -1)[:, 1:], neighbours.reshape(len(points), -1)[:, 1:]
    missing = count - distances.shape[1]
    own = np.broadcast_to(np.arange(len(points))[:, None], (len(points), missing))
    return (
        np.concatenate([distances, np.full((len(points), missing), np.inf)], axis=1),
        np.concatenate([neighbours, own], axis=1).astype(np.int64),
    )
