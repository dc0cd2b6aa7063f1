"""Slicing without meshes: a solid as the volumes of the cells of a grid, divided by planes in compiled code.

A `Body` is a solid in its canonical frame C, as the exact volumes within the cells of a grid. A plane divides every
cell in proportion to the part of it that lies on either side; what lies on one side is a product. The IoU of a product
and another body is estimated as the score defines it: both in their canonical frames, under the best of the four flips.
In a cell that both fill in part they are taken to share as much as they can, which is exact where their surfaces meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from scipy.spatial import ConvexHull

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.fragment import Cloud, Fragment, Mesh
from cutgrammar.inference.draws import Compiled

HALF = 7
"""Number of cells on either side of zero along every axis."""
STEPS = 18
"""Bisections of an offset."""


@dataclass(frozen=True, eq=False)
class Body:
    """A solid in its canonical frame C.

    Attributes:
        sizes: (3,) size of a cell [m].
        fine: (4 HALF + 4, ...) filled share on a grid of half the size, interpolated between the centres of the cells.
        centres: (n, 3) centres of the cells that hold volume, in C [m].
        volumes: (n,) their volumes [m3].
    """

    sizes: Floats
    fine: Floats
    centres: Floats
    volumes: Floats

    @property
    def volume(self) -> float:
        """Of the solid [m3]."""
        return float(self.volumes.sum())

    @property
    def arrays(self) -> tuple[Any, ...]:
        """For compiled functions."""
        return self.centres, self.volumes, self.sizes

    def offsets_for(self, normals: Floats, shares: Floats) -> Floats:
        """(n,) offsets of the planes with these normals (n, 3) that leave these shares (n,) on their positive side."""
        offsets: Floats = _offsets_for(normals, shares, self.arrays)
        return offsets

    def shares(self, planes: Floats) -> Floats:
        """(n,) share of the volume on the positive side of each plane (n, 4) in C."""
        shares: Floats = _shares(planes, self.arrays)
        return shares

    def spreads(self, planes: Floats, positive: bool) -> Floats:
        """(n, 3) standard deviations of each product's volume along its canonical axes, ascending [m]."""
        spreads: Floats = _spreads(planes, positive, self.arrays)
        return spreads

    def ious(self, planes: Floats, positive: bool, other: "Body") -> Floats:
        """(n,) IoU of `other` with the product on the positive or the negative side of each plane (n, 4) in C."""
        ious: Floats = _ious(planes, positive, self.arrays, other.fine, other.sizes, other.volume)
        return ious


def body_of(shape: Mesh | Cloud) -> Body:
    """The body of a mesh, or of the convex hull of a cloud.

    Raises:
        ValueError: a mesh without volume, or a cloud with fewer than four points.
    """
    mesh = shape if isinstance(shape, Mesh) else _hull(shape)
    X_CF = canonical_frame(shape).inverse()
    p_CV = X_CF.apply(mesh.vertices)
    sizes = np.maximum(np.abs(p_CV).max(axis=0) / HALF, 1e-6)
    cells = cell_volumes(p_CV[mesh.faces], sizes, HALF)
    filled = np.argwhere(cells > 1e-9 * cells.sum())
    centres = (filled - HALF + 0.5) * sizes
    return Body(sizes, _interpolated(np.minimum(cells / sizes.prod(), 1.0)), centres, cells[tuple(filled.T)])


def _interpolated(fill: Floats) -> Floats:
    """Filled shares of cells (n, n, n), interpolated on cells of half the size (2 n + 4, ...), with an empty margin."""
    fine = np.pad(fill, 1)
    for axis in range(3):
        padded = np.pad(fine, [(1, 1) if a == axis else (0, 0) for a in range(3)])
        n = padded.shape[axis]
        here = np.take(padded, np.arange(1, n - 1), axis)
        before, after = np.take(padded, np.arange(n - 2), axis), np.take(padded, np.arange(2, n), axis)
        pairs = np.stack([0.75 * here + 0.25 * before, 0.75 * here + 0.25 * after], axis + 1)
        fine = pairs.reshape([2 * size if a == axis else size for a, size in enumerate(here.shape)])
    return np.ascontiguousarray(fine)


def union_of(fragments: Sequence[Fragment]) -> Body:
    """The body of fragments that lie beside each other, as one solid in their places.

    Raises:
        ValueError: as `body_of`.
    """
    meshes = [f.shape if isinstance(f.shape, Mesh) else _hull(f.shape) for f in fragments]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    vertices = np.concatenate([f.X_WF.apply(mesh.vertices) for f, mesh in zip(fragments, meshes, strict=True)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return body_of(Mesh(vertices, faces))


def _hull(cloud: Cloud) -> Mesh:
    """The convex hull of a cloud, with outward faces."""
    hull = ConvexHull(cloud.points)
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return Mesh(hull.points, faces.astype(np.int64))


@njit(cache=True)
def _part(i: int, nx: float, ny: float, nz: float, d: float, body: Compiled) -> float:
    """Part of cell i on the positive side of a plane, as if the cell were as wide along the normal everywhere."""
    centres, _, sizes = body
    distance = nx * centres[i, 0] + ny * centres[i, 1] + nz * centres[i, 2] + d
    width = abs(nx) * sizes[0] + abs(ny) * sizes[1] + abs(nz) * sizes[2]
    part: float = min(max(0.5 + distance / width, 0.0), 1.0)
    return part


@njit(cache=True)
def _share(nx: float, ny: float, nz: float, d: float, body: Compiled) -> float:
    volumes = body[1]
    above, total = 0.0, 0.0
    for i in range(len(volumes)):
        above += volumes[i] * _part(i, nx, ny, nz, d, body)
        total += volumes[i]
    share: float = above / total
    return share


@njit(cache=True)
def _shares(planes: Compiled, body: Compiled) -> Compiled:
    shares = np.empty(len(planes))
    for p in range(len(planes)):
        shares[p] = _share(planes[p, 0], planes[p, 1], planes[p, 2], planes[p, 3], body)
    return shares


@njit(cache=True)
def _offsets_for(normals: Compiled, shares: Compiled, body: Compiled) -> Compiled:
    offsets = np.empty(len(normals))
    sizes = body[2]
    for p in range(len(normals)):
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        reach = (HALF + 1) * (abs(nx) * sizes[0] + abs(ny) * sizes[1] + abs(nz) * sizes[2])
        low, high = -reach, reach  # the share grows with the offset
        for _ in range(STEPS):
            middle = (low + high) / 2.0
            if _share(nx, ny, nz, middle, body) < shares[p]:
                low = middle
            else:
                high = middle
        offsets[p] = (low + high) / 2.0
    return offsets


@njit(cache=True)
def _product(plane: Compiled, positive: bool, body: Compiled, weights: Compiled) -> Compiled:
    """Fill in the volume of each cell in the product; return its volume, its centre, spreads and axes (3, 3)."""
    centres, volumes, sizes = body
    total = 0.0
    mean = np.zeros(3)
    for i in range(len(volumes)):
        part = _part(i, plane[0], plane[1], plane[2], plane[3], body)
        weights[i] = volumes[i] * (part if positive else 1.0 - part)
        total += weights[i]
        for a in range(3):
            mean[a] += weights[i] * centres[i, a]
    moment = np.zeros((3, 3))
    if total <= 0.0:
        return 0.0, mean, np.zeros(3), np.eye(3)
    mean /= total
    for i in range(len(volumes)):
        if weights[i] > 0.0:
            x, y, z = centres[i, 0] - mean[0], centres[i, 1] - mean[1], centres[i, 2] - mean[2]
            moment[0, 0] += weights[i] * x * x
            moment[1, 1] += weights[i] * y * y
            moment[2, 2] += weights[i] * z * z
            moment[0, 1] += weights[i] * x * y
            moment[0, 2] += weights[i] * x * z
            moment[1, 2] += weights[i] * y * z
    moment /= total
    for a in range(3):
        moment[a, a] += sizes[a] ** 2 / 12.0
        for b in range(a):
            moment[a, b] = moment[b, a]
    variances, axes = np.linalg.eigh(moment)
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    return total, mean, np.sqrt(np.maximum(variances, 1e-18)), axes


@njit(cache=True)
def _spreads(planes: Compiled, positive: bool, body: Compiled) -> Compiled:
    spreads = np.empty((len(planes), 3))
    weights = np.empty(len(body[1]))
    for p in range(len(planes)):
        spreads[p] = _product(planes[p], positive, body, weights)[2]
    return np.maximum(spreads, 1e-9)


@njit(cache=True)
def _ious(
    planes: Compiled, positive: bool, body: Compiled, fill: Compiled, sizes: Compiled, other_volume: float
) -> Compiled:
    centres = body[0]
    cell = body[2][0] * body[2][1] * body[2][2]
    ious = np.zeros(len(planes))
    weights = np.empty(len(centres))
    signs = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    shared = np.empty(4)
    n, middle = len(fill), len(fill) / 2.0
    for p in range(len(planes)):
        volume, mean, _, axes = _product(planes[p], positive, body, weights)
        if volume <= 0.0:
            continue
        shared[:] = 0.0
        for i in range(len(centres)):
            if weights[i] <= 0.0:
                continue
            x, y, z = centres[i, 0] - mean[0], centres[i, 1] - mean[1], centres[i, 2] - mean[2]
            u = 2.0 * (axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z) / sizes[0]
            v = 2.0 * (axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z) / sizes[1]
            w = 2.0 * (axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z) / sizes[2]
            for s in range(4):
                a = int(np.floor(signs[s, 0] * u + middle))
                b = int(np.floor(signs[s, 1] * v + middle))
                c = int(np.floor(signs[s, 2] * w + middle))
                if 0 <= a < n and 0 <= b < n and 0 <= c < n:
                    shared[s] += min(weights[i], cell * fill[a, b, c])
        most = shared.max()
        ious[p] = most / (volume + other_volume - most)
    return ious
