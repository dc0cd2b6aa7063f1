"""Instance segmentation of a fused cloud into fragments (IV-D): a small network on the graph of neighbouring points.

As in the point-cloud segmentation that the paper uses (PointGroup), points are described by a learned network and then
grouped; but what is learned is not a shift to an object's centre, which fragments that touch on all sides share the
scale of, but for each edge between neighbours the probability that both ends belong to one fragment. Points exchange
what they know along longer and shorter edges, one round each. Grouping is by the mean probability along whole seams
(`agglomeration`).

Two fragments that fit together as they were cut show no seam that a depth camera could see. A robot can
knows beside the cloud: it says of some points that they belong to what it saw before, and the segmentation holds to it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.mlp import MLP, from_bytes, to_bytes
from cutgrammar.perception.vision.agglomeration import agglomerate
from cutgrammar.perception.vision.neighbourhoods import (
    EDGE_FEATURES,
    LONGEST,
    POINT_FEATURES,
    Neighbourhoods,
    Thinned,
    describe,
    thin,
)

FEWEST = 12
"""A cluster of fewer thinned points is no fragment; its points go to the nearest that is."""
THRESHOLDS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
"""Tried where it is known how many clusters there should be."""
UNKNOWN = -1
"""What a point is believed to belong to if nothing is known of it."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Fused cloud -> the fragment of each point.

    Attributes:
        describing: features of a point -> what it knows (h).
        rounds: of each exchange, (both ends and the edge -> message, own and pooled messages -> what is added).
        judging: both ends and the edge -> log odds that the ends belong together.
        threshold: mean probability along a seam from which on two clusters are one.
    """

    describing: MLP
    rounds: tuple[tuple[MLP, MLP], ...]
    judging: MLP
    threshold: float

    def __post_init__(self) -> None:
        h = self.describing.sizes[-1]
        fits = self.describing.sizes[0] == POINT_FEATURES
        fits &= (self.judging.sizes[0], self.judging.sizes[-1]) == (2 * h + EDGE_FEATURES, 1)
        for message, update in self.rounds:
            fits &= (message.sizes[0], update.sizes[0], update.sizes[-1]) == (
                2 * h + EDGE_FEATURES,
                h + 2 * message.sizes[-1],
                h,
            )
        if not fits:
            raise ValueError("the layers of the segmentation do not fit one another or the features of points")
        if not 0.0 < self.threshold < 1.0:
            raise ValueError(f"the threshold of the segmentation is {self.threshold}; it lies between 0 and 1")

    def __reduce__(self) -> tuple[Any, ...]:
        return Segmentation, (self.describing, self.rounds, self.judging, self.threshold)

    def __call__(
        self, points: Floats, normals: Floats, believed: Ints | None = None, expected: int | None = None
    ) -> Ints:
        """(n,) the fragment of each point, numbered from 0; the order of the points does not matter.

        Args:
            points: (n, 3) in W, whose z = 0 is the board's top [m].
            normals: (n, 3) outward unit normals.
            believed: (n,) what each point is known to belong to, `UNKNOWN` where nothing is known. Points with one
                value are kept together, with two values apart; the first clusters are those values, ascending.
            expected: number of further clusters that there should be: of several thresholds the one whose number is
                nearest to it is taken, of equals the one nearest to its own. None: its own.

        Raises:
            ValueError: fewer than two points.
        """
        if len(points) < 2:
            raise ValueError(f"{len(points)} points are too few to be segmented")
        thinned = thin(points, normals)
        known = np.unique(np.empty(0, np.int64) if believed is None else believed[believed != UNKNOWN])
        held = np.full(len(thinned.points), UNKNOWN)
        if believed is not None:
            held = _majority(thinned.cell_of, np.where(believed == UNKNOWN, UNKNOWN, np.searchsorted(known, believed)))
        edges, p = self.together(describe(thinned.points, thinned.normals))
        thresholds = [self.threshold]
        if expected is not None:
            thresholds += sorted(THRESHOLDS, key=lambda threshold: abs(threshold - self.threshold))
        labels, off = None, 0
        for threshold in thresholds:
            tried = grouped(thinned, edges, p, threshold, held, len(known))
            too_many = int(tried.max()) + 1 - len(known) - (expected or 0)
            if labels is None or abs(too_many) < off:
                labels, off = tried, abs(too_many)
            if not off:
                break
        assert labels is not None
        if believed is not None:
            labels = np.where(believed == UNKNOWN, labels, np.searchsorted(known, believed))
        return np.asarray(labels, dtype=np.int64)

    def together(self, seen: Neighbourhoods) -> tuple[Ints, Floats]:
        """The edges (e, 2) between near points, and the probability (e,) that both ends belong to one fragment."""
        h = np.maximum(self.describing(seen.points), 0.0)
        for number, (message, update) in enumerate(self.rounds):
            others, edges = (seen.near, seen.near_edges) if number % 2 else (seen.far, seen.far_edges)
            own = np.broadcast_to(h[:, None], (*others.shape, h.shape[1]))
            rows = np.concatenate([own, h[others], edges], axis=2).reshape(others.size, -1)
            told = np.maximum(message(rows), 0.0).reshape(*others.shape, -1)
            h = h + update(np.concatenate([h, told.mean(axis=1), told.max(axis=1)], axis=1))
        first, column = np.nonzero(seen.lengths <= LONGEST)
        second = seen.near[first, column]
        rows = np.concatenate(
            [h[first] + h[second], np.abs(h[first] - h[second]), seen.near_edges[first, column]], axis=1
        )
        p = np.exp(-np.logaddexp(0.0, -self.judging(rows)[:, 0]))
        ends = np.sort(np.stack([first, second], axis=1), axis=1)
        edges_once, which = np.unique(ends, axis=0, return_inverse=True)
        which = which.ravel()
        return edges_once, np.bincount(which, p, len(edges_once)) / np.bincount(which, minlength=len(edges_once))

    def to_bytes(self) -> bytes:
        """In the safetensors format."""
        parts = {"describing": self.describing}
        for i, (message, update) in enumerate(self.rounds):
            parts |= {f"message{i}": message, f"update{i}": update}
        others = {
            f"{name}.{i}.{kind}": array
            for name, layers in parts.items()
            for kind, arrays in (("weight", layers.weights), ("bias", layers.biases))
            for i, array in enumerate(arrays)
        }
        return to_bytes(self.judging, **others, threshold=np.array([self.threshold]))

    @staticmethod
    def from_bytes(data: bytes) -> "Segmentation":
        """The inverse of `to_bytes`.

        Raises:
            ValueError: not such bytes.
        """
        judging, others = from_bytes(data)
        rounds = sum(name.startswith("message") and name.endswith(".0.weight") for name in others)
        try:
            return Segmentation(
                _read(others, "describing"),
                tuple((_read(others, f"message{i}"), _read(others, f"update{i}")) for i in range(rounds)),
                judging,
                float(others["threshold"][0]),
            )
        except KeyError as error:
            raise ValueError(f"not a segmentation: it lacks {error}") from None


def grouped(
    thinned: Thinned, edges: Ints, p: Floats, threshold: float, held: Ints | None = None, known: int = 0
) -> Ints:
    """(n,) the cluster of each point of a cloud, numbered from 0; things believed first.

    Args:
        thinned: the m points that the cloud was thinned to.
        edges, p: (e, 2), (e,) as of `Segmentation.together`.
        threshold: mean probability along a seam from which on two clusters are one.
        held: (m,) what each thinned point is believed to belong to, from 0, or `UNKNOWN`.
        known: number of things believed.
    """
    held = np.full(len(thinned.points), UNKNOWN) if held is None else held
    node = np.where(held == UNKNOWN, known - 1 + np.cumsum(held == UNKNOWN), held)  # a thing believed is one node
    kinds = np.where(np.arange(int(node.max()) + 1) < known, np.arange(int(node.max()) + 1), UNKNOWN)
    between = node[edges]
    used = (between[:, 0] != between[:, 1]) & (between >= known).any(axis=1)
    labels = agglomerate(len(kinds), between[used], p[used], threshold, kinds)[node]
    return _without_crumbs(thinned.points, labels, held, known)[thinned.cell_of]


def _read(arrays: Any, name: str) -> MLP:
    count = max(1, sum(key.startswith(f"{name}.") and key.endswith(".weight") for key in arrays))
    return MLP(
        tuple(arrays[f"{name}.{i}.weight"] for i in range(count)),
        tuple(arrays[f"{name}.{i}.bias"] for i in range(count)),
    )


def _majority(cell_of: Ints, believed: Ints) -> Ints:
    """(m,) what most points of each cell are believed to belong to; the first of equals."""
    values, index = np.unique(believed, return_inverse=True)
    cells = int(cell_of.max()) + 1
    votes = np.bincount(cell_of * len(values) + index.ravel(), minlength=cells * len(values))
    return np.asarray(values[votes.reshape(cells, len(values)).argmax(axis=1)])


def _without_crumbs(points: Floats, labels: Ints, held: Ints, known: int) -> Ints:
    """The clusters renumbered: the `known` things believed first; the points of small ones go to the nearest."""
    believed = np.full(int(labels.max()) + 1, UNKNOWN)
    believed[labels[held != UNKNOWN]] = held[held != UNKNOWN]
    large = (np.bincount(labels) >= FEWEST) | (believed != UNKNOWN)
    number = np.where(believed != UNKNOWN, believed, known - 1 + np.cumsum(large & (believed == UNKNOWN)))
    kept = large[labels]
    if not kept.any():  # so few points that all are one
        return np.zeros(len(labels), dtype=np.int64)
    renumbered = number[labels]
    if not kept.all():
        renumbered[~kept] = renumbered[kept][cKDTree(points[kept]).query(points[~kept])[1]]
    return np.asarray(renumbered)
