"""What the points of a fused cloud look like to one another: the inputs of the segmentation.

The cloud is first thinned to one point a cell of a grid, the mean of those in it, which also takes away some noise.
Every point then looks at its neighbours at three scales. All numbers are lengths, angles and heights over the board,
so that neither the order of the points nor, but for the grid, a turn about the vertical or a shift along the board
changes them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats, Ints

CELL = 2.5e-3
"""Side of the cells in which points become one [m]."""
SCALES = (10, 24, 64)
"""Numbers of nearest neighbours that a point is described by."""
EDGES = 10
"""Nearest neighbours that a point has an edge to; as many farther ones, up to the last scale, tell it more."""
REACH = 0.012
"""Neighbours farther away than this count for nothing [m]."""
LONGEST = 0.008
"""An edge longer than this joins nothing [m]."""


@dataclass(frozen=True, eq=False)
class Thinned:
    """A cloud thinned.

    Attributes:
        points, normals: (m, 3) means in W [m].
        cell_of: (n,) the thinned point that each point of the cloud went into.
    """

    points: Floats
    normals: Floats
    cell_of: Ints


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """Points described.

    Attributes:
        points: (m, `POINT_FEATURES`).
        near: (m, `EDGES`) indices of the nearest points; a point stands in for neighbours that there are not.
        near_edges: (m, `EDGES`, `EDGE_FEATURES`) of the edges to them.
        far: (m, `EDGES`) some of the farther ones.
        far_edges: (m, `EDGES`, `EDGE_FEATURES`).
        lengths: (m, `EDGES`) of the edges to the nearest points [m]; infinite where a point stands in.
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
    """One point for each cell of a grid in W; their order does not depend on the order of the points (n, 3)."""
    order = np.lexsort(points.T)  # sums then come out alike, to the bit, in whatever order the points come
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
    """How every point (m, 3) with its normal (m, 3) and its edges look."""
    distances, neighbours = _nearest(points, SCALES[-1])
    offsets = points[neighbours] - points[:, None]
    counts_for = (distances <= REACH).astype(np.float64)
    features = [normals[:, 2], np.minimum(points[:, 2] / 0.02, 3.0)]
    sideways, mean_normals = [], []
    for scale in SCALES:
        weight = counts_for[:, :scale, None]
        count = np.maximum(weight.sum(axis=1), 1.0)
        near = offsets[:, :scale] * weight
        middle = near.sum(axis=1) / count
        spread = np.matmul(near.transpose(0, 2, 1), near) / count[:, :, None]
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
    near_ones, far_ones = neighbours[:, :EDGES], neighbours[:, EDGES :: (SCALES[-1] - EDGES) // EDGES][:, :EDGES]
    near_edges, far_edges = (_edges(points, normals, ones, sideways, mean_normals) for ones in (near_ones, far_ones))
    return Neighbourhoods(np.stack(features, axis=1), near_ones, near_edges, far_ones, far_edges, distances[:, :EDGES])


def _edges(points: Floats, normals: Floats, others: Ints, sideways: list[Floats], mean_normals: list[Floats]) -> Floats:
    """(m, k, `EDGE_FEATURES`) of the edges from each point to `others` (m, k)."""
    along = points[others] - points[:, None]
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-6)
    towards = along / length[..., None]

    def both(at: Floats) -> tuple[Floats, Floats]:
        """How far directions (m, 3) at the one end and at the other point to the other end."""
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
    """(m, count) distances and indices of the nearest others; for missing ones the point itself, infinitely far."""
    distances, neighbours = cKDTree(points).query(points, k=min(count, len(points) - 1) + 1)
    distances, neighbours = distances.reshape(len(points), -1)[:, 1:], neighbours.reshape(len(points), -1)[:, 1:]
    missing = count - distances.shape[1]
    own = np.broadcast_to(np.arange(len(points))[:, None], (len(points), missing))
    return (
        np.concatenate([distances, np.full((len(points), missing), np.inf)], axis=1),
        np.concatenate([neighbours, own], axis=1).astype(np.int64),
    )
