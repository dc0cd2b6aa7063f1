"""How well fragments match: exact volume IoU in canonical frames, and the best matching of two configurations (IV-B2).

Each pair is compared with its canonical frames laid on one another, in the best of the four proper choices of signs.
Pairs are matched by linear assignment. The volumes and boxes of two fragments bound their IoU from above; a pair whose
bound never enters an optimal assignment is not computed, and the matching stays exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import manifold3d
import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.canonical import FLIPS, canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import solid_of


class Solid:
    """A mesh in its canonical frame, ready to be compared with others."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh.moved(canonical_frame(mesh).inverse())
        self.volume = mesh.volume
        self.lowest: Floats = self.mesh.vertices.min(axis=0)
        self.highest: Floats = self.mesh.vertices.max(axis=0)

    @cached_property
    def flipped(self) -> tuple[manifold3d.Manifold, ...]:
        """The solid under each of `FLIPS`."""
        return tuple(solid_of(self.mesh.moved(flip)) for flip in FLIPS)


def bounds(a: Solid, b: Solid) -> Floats:
    """(4,) upper bound of the IoU of `a` and `b` under each of `FLIPS` of `b`, from volumes and boxes alone."""
    result = np.zeros(4)
    for i, flip in enumerate(FLIPS):
        corners = flip.apply(np.stack([b.lowest, b.highest]))
        sides = np.minimum(a.highest, corners.max(axis=0)) - np.maximum(a.lowest, corners.min(axis=0))
        shared = min(a.volume, b.volume, float(np.prod(np.maximum(sides, 0.0))))
        result[i] = shared / (a.volume + b.volume - shared)
    return result


def iou(a: Solid, b: Solid) -> float:
    """Intersection over union of two solids, the best of the four flips, exact up to rounding."""
    limit = bounds(a, b)
    best = 0.0
    for i in np.argsort(-limit, kind="stable"):
        if limit[i] <= best:
            break
        shared = (a.flipped[0] ^ b.flipped[i]).volume()
        best = max(best, shared / (a.volume + b.volume - shared))
    return float(best)


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
    value = np.array([[bounds(a, b).max() for b in goal] for a in reached])
    known = np.zeros(value.shape, dtype=bool)
    while True:
        rows, columns = linear_sum_assignment(value, maximize=True)
        open_pairs = [(i, j) for i, j in zip(rows, columns, strict=True) if not known[i, j]]
        if not open_pairs:
            return Matching(rows, columns, value[rows, columns], max(value.shape))
        for i, j in open_pairs:
            value[i, j] = iou(reached[i], goal[j])
            known[i, j] = True
