"""How well fragments match: exact volume IoU in canonical frames, and the best matching of two configurations (IV-B2).

Each pair is compared with its canonical frames laid on one another, in the best of the four proper choices of signs.
Pairs are matched by linear assignment. What two solids share is at most what the emptier of them has in each cell of a
grid, summed over the cells; a pair whose bound never enters an optimal assignment is not computed, nor is a choice of
signs whose bound is under the best found, and the matching stays exact.
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
"""Cells on either side of zero in the grid of the bounds, along every axis."""


_WITH_MANIFOLD: "WeakSet[Solid]" = WeakSet()
"""The solids whose manifold exists."""


class Solid:
    """A mesh in its canonical frame, ready to be compared with others."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh.moved(canonical_frame(mesh).inverse())
        self.volume = mesh.volume
        self.reach: Floats = np.abs(self.mesh.vertices).max(axis=0)

    @cached_property
    def manifold(self) -> manifold3d.Manifold:
        """The solid for exact booleans."""
        _WITH_MANIFOLD.add(self)
        return solid_of(self.mesh)

    def shared_with(self, other: "Solid", turn: Floats) -> float:
        """Volume shared with `other` turned about the origin by `turn` (3, 3), exact up to rounding [m3]."""
        turned = other.manifold.transform(np.column_stack([turn, np.zeros(3)]))
        return float((self.manifold ^ turned).volume())

    def iou_with(self, other: "Solid", turn: Floats) -> float:
        """Intersection over union with `other` turned about the origin by `turn` (3, 3), exact up to rounding."""
        shared = self.shared_with(other, turn)
        return shared / (self.volume + other.volume - shared)


@atexit.register
def _free_manifolds() -> None:
    """Free all manifolds at exit, whoever keeps the solids: nanobind reports those that outlive the interpreter."""
    for solid in list(_WITH_MANIFOLD):
        solid.__dict__.pop("manifold", None)


def bounds(a: Sequence[Solid], b: Sequence[Solid]) -> Floats:
    """(a, b, 4) upper bounds of the IoU of every solid of `a` and of `b` under each of `FLIPS` of the latter."""
    sizes = np.max([solid.reach for solid in b], axis=0) / CELLS
    ours, theirs = (np.array([_cells(solid, tuple(sizes)) for solid in solids]) for solids in (a, b))
    turned = np.stack([_reversed(theirs, np.diag(flip.rotation)) for flip in FLIPS], axis=1)
    shared: Floats = _shared_at_most(ours.reshape(len(a), -1), turned.reshape(len(b), len(FLIPS), -1))
    both = np.add.outer([solid.volume for solid in a], [solid.volume for solid in b])[:, :, None]
    return shared / (both - shared)


def iou(a: Solid, b: Solid) -> float:
    """Intersection over union of two solids, the best of the four flips, exact up to rounding."""
    return _best_flip(a, b, bounds([a], [b])[0, 0])


def _best_flip(a: Solid, b: Solid, limits: Floats) -> float:
    """The IoU of two solids, given its upper bound (4,) under each flip."""
    best = 0.0
    for i in np.argsort(-limits, kind="stable"):
        if limits[i] <= best:
            break
        best = max(best, a.iou_with(b, FLIPS[i].rotation))
    return best


@lru_cache(maxsize=512)
def _cells(solid: Solid, sizes: tuple[float, ...]) -> Floats:
    """Volume of the solid in every cell of a grid of cells of these sizes; kept, since one goal is met many times."""
    return cell_volumes(solid.mesh.triangles, np.array(sizes), CELLS)


def _reversed(cells: Floats, signs: Floats) -> Floats:
    """Tables of cell volumes (n, c, c, c) of solids whose axes change signs (3,)."""
    return np.asarray(np.flip(cells, tuple(axis + 1 for axis in range(3) if signs[axis] < 0)))


@njit(cache=True)
def _shared_at_most(ours: Floats, theirs: Floats) -> Floats:
    """(a, b, f) sums over cells of the lesser of `ours` (a, c) and `theirs` (b, f, c)."""
    shared = np.zeros((ours.shape[0], theirs.shape[0], theirs.shape[1]))
    for i in range(ours.shape[0]):
        for j in range(theirs.shape[0]):
            for f in range(theirs.shape[1]):
                total = 0.0
                for c in range(ours.shape[1]):
                    total += min(ours[i, c], theirs[j, f, c])
                shared[i, j, f] = total
    return shared


@dataclass(frozen=True, eq=False)
class Matching:
    """The best-matched pairs of a configuration reached and a goal.

    Attributes:
        reached: (p,) indices of the matched fragments reached.
        goal: (p,) indices of the goal fragments they are matched with.
        ious: (p,) IoU of every pair.
        larger: the larger of the two numbers of fragments.
    """

    reached: Ints
    goal: Ints
    ious: Floats
    larger: int

    @property
    def mean(self) -> float:
        """Mean best-matched IoU over the matched pairs (the paper's, IV-B2)."""
        return float(self.ious.mean())

    @property
    def strict(self) -> float:
        """Sum over the pairs divided by the larger count, so that stopping early cannot win."""
        return float(self.ious.sum() / self.larger)


def best_match(reached: Sequence[Solid], goal: Sequence[Solid]) -> Matching:
    """The assignment of fragments reached to goal fragments with the greatest sum of IoU (IV-B2), exact.

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
