"""Exact volume IoU of fragments in canonical frames, and the best matching of two configurations (IV-B2).

Two fragments are compared with their canonical frames aligned, using the best of the four proper sign choices
(`FLIPS`). Fragments are matched by linear assignment. The shared volume of two solids is at most the sum over the cells
of a grid of the smaller of their volumes in the cell. With this upper bound, exact booleans are computed only for pairs
that enter an optimal assignment and for sign choices that can improve on the best one; the matching remains exact.
"""

import atexit
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from weakref import WeakSet

import manifold3d
import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import FLIPS, canonical_frame
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import solid_of

CELLS = 10
"""Number of cells on either side of zero along every axis, in the grid of the bounds."""


_WITH_MANIFOLD: "WeakSet[Solid]" = WeakSet()
"""The solids whose manifold exists."""


class Solid:
    """A mesh in its canonical frame C, prepared for comparisons.

    Attributes:
        X_CF: pose of the mesh's own frame F in C.
        mesh: the mesh, moved into C.
        volume: its volume [m3].
        half_extents: (3,) greatest distance of a vertex from C's origin along each axis of C [m].
    """

    def __init__(self, mesh: Mesh) -> None:
        self.X_CF = canonical_frame(mesh).inverse()
        self.mesh = mesh.moved(self.X_CF)
        self.volume = mesh.volume
        self.half_extents: Floats = np.abs(self.mesh.vertices).max(axis=0)

    @cached_property
    def manifold(self) -> manifold3d.Manifold:
        """The manifold3d solid, for exact booleans."""
        _WITH_MANIFOLD.add(self)
        return solid_of(self.mesh)

    def shared_volume(self, other: "Solid", rotation: Floats) -> float:
        """Volume shared with `other` rotated about the origin by `rotation` (3, 3), exact up to rounding [m3]."""
        rotated = other.manifold.transform(np.column_stack([rotation, np.zeros(3)]))
        return float((self.manifold ^ rotated).volume())

    def iou_with(self, other: "Solid", rotation: Floats) -> float:
        """Intersection over union with `other` rotated about the origin by `rotation` (3, 3), exact up to rounding."""
        shared = self.shared_volume(other, rotation)
        return shared / (self.volume + other.volume - shared)


@atexit.register
def _free_manifolds() -> None:
    """Free all manifolds at exit, whoever keeps the solids: nanobind reports those that outlive the interpreter."""
    for solid in list(_WITH_MANIFOLD):
        solid.__dict__.pop("manifold", None)


def bounds(a: Sequence[Solid], b: Sequence[Solid]) -> Floats:
    """(a, b, 4) upper bounds of the IoU of every solid of `a` with every solid of `b` under each of `FLIPS`."""
    sizes = np.max([solid.half_extents for solid in b], axis=0) / CELLS
    cells_a, cells_b = (np.array([_cells(solid, tuple(sizes)) for solid in solids]) for solids in (a, b))
    rotated = np.stack([_reversed(cells_b, np.diag(flip.rotation)) for flip in FLIPS], axis=1)
    shared: Floats = _max_shared(cells_a.reshape(len(a), -1), rotated.reshape(len(b), len(FLIPS), -1))
    both = np.add.outer([solid.volume for solid in a], [solid.volume for solid in b])[:, :, None]
    return shared / (both - shared)


def iou(a: Solid, b: Solid) -> float:
    """Intersection over union of two solids under the best of the four flips, exact up to rounding."""
    return _best_flip(a, b, bounds([a], [b])[0, 0])


def _best_flip(a: Solid, b: Solid, limits: Floats) -> float:
    """The IoU under the best flip, given an upper bound (4,) for each flip."""
    best = 0.0
    for i in np.argsort(-limits, kind="stable"):
        if limits[i] <= best:
            break
        best = max(best, a.iou_with(b, FLIPS[i].rotation))
    return best


@lru_cache(maxsize=512)
def _cells(solid: Solid, sizes: tuple[float, ...]) -> Floats:
    """Volume of the solid in every cell of a grid; cached, because goals are compared many times."""
    return cell_volumes(solid.mesh.triangles, np.array(sizes), CELLS)


def _reversed(cells: Floats, signs: Floats) -> Floats:
    """Cell volumes (n, c, c, c) of solids whose axes are multiplied by these signs (3,)."""
    return np.asarray(np.flip(cells, tuple(axis + 1 for axis in range(3) if signs[axis] < 0)))


@njit(cache=True)
def _max_shared(cells_a: Floats, cells_b: Floats) -> Floats:
    """(a, b, f) sums over cells of the minimum of `cells_a` (a, c) and `cells_b` (b, f, c)."""
    shared = np.zeros((cells_a.shape[0], cells_b.shape[0], cells_b.shape[1]))
    for i in range(cells_a.shape[0]):
        for j in range(cells_b.shape[0]):
            for f in range(cells_b.shape[1]):
                total = 0.0
                for c in range(cells_a.shape[1]):
                    total += min(cells_a[i, c], cells_b[j, f, c])
                shared[i, j, f] = total
    return shared


@dataclass(frozen=True, eq=False)
class Matching:
    """The matched pairs of a reached configuration and a goal.

    Attributes:
        reached: (p,) indices of the matched fragments of the reached configuration.
        goal: (p,) indices of the goal fragments that they are matched with.
        ious: (p,) IoU of each pair.
        larger: number of fragments in the larger configuration.
    """

    reached: Ints
    goal: Ints
    ious: Floats
    larger: int

    @property
    def mean(self) -> float:
        """Mean IoU over the matched pairs (as in the paper, IV-B2)."""
        return float(self.ious.mean())

    @property
    def strict(self) -> float:
        """Sum of the IoU over the pairs divided by `larger`, which penalises missing and surplus fragments."""
        return float(self.ious.sum() / self.larger)


def best_match(reached: Sequence[Solid], goal: Sequence[Solid]) -> Matching:
    """The one-to-one matching of reached and goal fragments that maximises the sum of IoU (IV-B2), exact.

    Raises:
        ValueError: an empty configuration.
    """
    if not reached or not goal:
        raise ValueError("a configuration without fragments cannot be matched")
    limits = bounds(reached, goal)
    value = limits.max(axis=2)
    known = np.zeros(value.shape, dtype=bool)
    while True:
        rows, columns = linear_sum_assignment(value, maximize=True)
        open_pairs = [(i, j) for i, j in zip(rows, columns, strict=True) if not known[i, j]]
        if not open_pairs:
            return Matching(rows, columns, value[rows, columns], max(value.shape))
        for i, j in open_pairs:
            value[i, j] = _best_flip(reached[i], goal[j], limits[i, j])
            known[i, j] = True
