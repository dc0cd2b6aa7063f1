"""From the points of an untrusted file to the surface of a solid: normals checked or estimated, and a closed mesh.

Normals that point inwards are turned; missing or contradictory ones are estimated, each from the plane through its
neighbours, with signs spread along the minimum spanning tree of neighbours (Hoppe et al., Surface Reconstruction from
Unorganized Points, SIGGRAPH 1992). The surface is where the winding number of the points is one half (Barill et al.,
Fast Winding Numbers for Soups and Clouds, SIGGRAPH 2018); it closes gaps, and it is refused where they are too large.
"""

import manifold3d
import numpy as np
from numba import njit
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import KDTree

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.mesh_io.repair import MIN_THICKNESS, Place, sound, thickness
from cutgrammar.geometry.slicing import mesh_of

MIN_POINTS = 32
"""Minimum number of points in a cloud of a fragment."""
MAX_POINTS = 4_000
"""Larger clouds are thinned before a surface is made of them."""
NEIGHBOURS = 10
TOLERANCES = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3, 8e-3, 1e-2)
"""Tolerances of the simplification, tried in turn, as shares of the largest extent."""
CELLS = (30, 24, 20, 16, 12)
"""Cells of the winding number's grid in a cube as large as the bounding box, tried in turn."""
MIN_CONSISTENT = 0.85
"""Least share of pairs of near neighbours whose given normals are not opposed; of random normals 0.75 are not."""
MAX_GAP = 0.15
"""Largest sum of all normals, as a share of that of their lengths; a closed surface has 0, a ball's half 0.5."""


def oriented_cloud(points: Floats, normals: Floats | None) -> tuple[Cloud, tuple[str, ...]]:
    """A cloud of surface points with outward unit normals, in the file's numbers, and notes on what was changed.

    Args:
        points: (n, 3) surface points.
        normals: (n, 3) normals of any length and direction; None: the file has none.

    Raises:
        InputError: there are too few points, or they are flat; the message does not name the file.
    """
    if len(points) < MIN_POINTS:
        raise InputError(f"has {len(points)} points and no triangles; a cloud needs at least {MIN_POINTS}")
    if not np.isfinite(points).all():
        raise InputError("has points that are not finite (NaN or infinite); export it again")
    points, kept = np.unique(points, axis=0, return_index=True)
    if len(points) < MIN_POINTS or thickness(points) < MIN_THICKNESS:
        raise InputError("is flat: its points are coplanar; a cloud from all sides of a fragment is needed")
    if normals is None:
        return Cloud(points, _estimated(points)), ("normals were estimated",)
    normals = np.asarray(normals, dtype=np.float64)[kept]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    if not np.isfinite(lengths).all() or (lengths <= 0.0).any():
        return Cloud(points, _estimated(points)), ("some normals were zero or not finite; all were estimated",)
    normals = normals / lengths
    near = KDTree(points).query(points, k=5)[1][:, 1:]
    if (np.einsum("ik,ijk->ij", normals, normals[near]) > -0.5).mean() < MIN_CONSISTENT:
        return Cloud(points, _estimated(points)), ("its normals contradict one another; they were estimated",)
    if _flux(points, normals) < 0.0:
        return Cloud(points, -normals), ("its normals pointed inwards and were turned",)
    return Cloud(points, normals), ()


def solid_from(cloud: Cloud) -> Mesh:
    """A closed mesh on whose surface the points lie, in the cloud's numbers.

    Raises:
        InputError: the points leave too large a part of the surface out, or no surface passes through them.
    """
    axes = np.linalg.eigh(np.cov(cloud.points.T)).eigenvectors
    axes[:, 0] *= np.sign(np.linalg.det(axes))  # a rotation: the grid runs along the principal axes
    count = len(cloud.points)
    # The order of points in a file may follow the lines of a scan, so that thinning by it would leave stripes.
    chosen = np.arange(count) if count <= MAX_POINTS else np.random.default_rng(0).permutation(count)[:MAX_POINTS]
    turned = cloud.points @ axes
    place = Place.of(turned)
    points = place.inwards(turned[chosen])
    reach = KDTree(points).query(points, k=NEIGHBOURS + 1)[0][:, -1]
    vectors = cloud.normals[chosen] @ axes * (np.pi * reach**2 / (NEIGHBOURS + 0.5))[:, None]
    gap = axes @ vectors.sum(axis=0) / np.linalg.norm(vectors, axis=1).sum()
    if np.linalg.norm(gap) > MAX_GAP:
        most = int(np.argmax(np.abs(gap)))
        raise InputError(
            f"misses its surface towards {'-' if gap[most] > 0 else '+'}{'xyz'[most]}, or its normals are wrong: they "
            "do not add up to zero, as those of a closed surface do; scan it from all sides, or export a closed mesh"
        )
    refusal = InputError("encloses no volume: no surface passes through its points; export a closed mesh")
    for cells in CELLS:
        try:
            unit_size = _level_surface(points, vectors, cells)
            return Mesh(place.outwards(unit_size.vertices) @ axes.T, unit_size.faces)
        except InputError as error:
            refusal = error
    raise refusal


def _level_surface(points: Floats, vectors: Floats, cells: int) -> Mesh:
    """The largest closed surface on which the winding number is one half."""
    cell = float(np.prod(np.ptp(points, axis=0)) ** (1.0 / 3.0)) / cells
    low, high = points.min(axis=0) - 2.0 * cell, points.max(axis=0) + 2.0 * cell
    level = manifold3d.Manifold.level_set(
        lambda x, y, z: _winding_number(points, vectors, x, y, z), [*low.tolist(), *high.tolist()], cell, 0.5
    )
    parts = [mesh_of(part) for part in level.decompose()] if not level.is_empty() else []
    largest = max(parts, key=lambda part: part.volume, default=None)
    if largest is None or largest.volume <= 0.0:
        raise InputError("encloses no volume: no surface passes through its points; export a closed mesh")
    return sound(largest, Place(np.zeros(3), 1.0), TOLERANCES, ())[0]


def _flux(points: Floats, normals: Floats) -> float:
    """Sum of n.(p - middle): over a closed surface with outward normals three times its volume, hence positive."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return float(np.einsum("ij,ij->", points - middle, normals))


def _estimated(points: Floats) -> Floats:
    """(n, 3) outward unit normals."""
    near = KDTree(points).query(points, k=NEIGHBOURS + 1)[1]
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    normals = np.linalg.svd(spread, full_matrices=False)[2][:, 2]
    rows, columns = np.repeat(np.arange(len(points)), NEIGHBOURS), near[:, 1:].ravel()
    costs = 1.0 + 1e-6 - np.abs(np.einsum("ij,ij->i", normals[rows], normals[columns]))
    tree = minimum_spanning_tree(coo_matrix((costs, (rows, columns)), shape=(len(points),) * 2).tocsr())
    reached = np.zeros(len(points), dtype=bool)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    while not reached.all():
        rest = np.flatnonzero(~reached)
        start = int(rest[np.argmax(np.linalg.norm(points[rest] - middle, axis=1))])
        order, before = breadth_first_order(tree, start, directed=False)
        if normals[start] @ (points[start] - middle) < 0.0:  # the farthest point faces away from the middle
            normals[start] *= -1.0
        normals = _signed(normals, np.asarray(order, dtype=np.int64), np.asarray(before, dtype=np.int64))
        reached[order] = True
    return normals if _flux(points, normals) >= 0.0 else -normals


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _signed(normals: Floats, order: Ints, before: Ints) -> Floats:
    """Normals with the sign that agrees with the one before them in the tree."""
    for i in order[1:]:
        if (normals[i] * normals[before[i]]).sum() < 0.0:
            normals[i] = -normals[i]
    return normals


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _winding_number(points: Floats, vectors: Floats, x: float, y: float, z: float) -> float:
    """Winding number at (x, y, z) of points with area vectors: 1 inside, 0 outside."""
    total = 0.0
    for i in range(len(points)):
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        square = dx * dx + dy * dy + dz * dz + 1e-6
        total += (dx * vectors[i, 0] + dy * vectors[i, 1] + dz * vectors[i, 2]) / (square * np.sqrt(square))
    return total / (4.0 * np.pi)
