"""Instance segmentation of a fused cloud into fragments (IV-D): a small network on the graph of neighbouring points.

As in PointGroup, the point-cloud segmentation that the paper uses, a network describes points, which are then grouped.
PointGroup learns the shift of each point to its object's centre, which is not reliable for small fragments that touch
on all sides. This network instead predicts, for each edge between neighbouring points, the probability that both ends
belong to the same fragment. Points exchange messages along far and near edges in alternating rounds. The grouping uses
the mean probability along whole seams (`agglomeration`).

Depth cameras cannot show the seam between two fragments that still fit together after a cut. A robot can provide its
knowledge from earlier views: the fragments that some of the points belong to, which the segmentation then respects.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.mlp import MLP, from_bytes, from_named_arrays, named_arrays, number_in, to_bytes
from cutgrammar.perception.vision.agglomeration import agglomerate
from cutgrammar.perception.vision.neighbourhoods import (
    EDGE_FEATURES,
    MAX_EDGE_LENGTH,
    POINT_FEATURES,
    Neighbourhoods,
    Thinned,
    describe,
    thin,
)

MIN_POINTS = 12
"""Minimum number of thinned points of a fragment; points of smaller clusters go to the nearest fragment."""
THRESHOLDS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
"""Thresholds to try if the number of clusters is known."""
UNKNOWN = -1
"""Believed fragment of a point for which nothing is known."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Fused cloud -> the fragment of each point.

    Attributes:
        describing: features of a point -> its state (h).
        rounds: for every round of message passing, (states of both ends, edge) -> message, and (state, pooled
            messages) -> update of the state.
        judging: (states of both ends, edge) -> log odds that the ends belong together.
        threshold: minimum mean probability along a seam for two clusters to be merged.
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
            raise ValueError("the layers of the segmentation do not match each other or the features of points")
        if not 0.0 < self.threshold < 1.0:
            raise ValueError(f"the threshold of the segmentation is {self.threshold}; it must be between 0 and 1")

    def __reduce__(self) -> tuple[Any, ...]:
        return Segmentation, (self.describing, self.rounds, self.judging, self.threshold)

    def __call__(
        self, points: Floats, normals: Floats, believed: Ints | None = None, expected: int | None = None
    ) -> Ints:
        """(n,) the fragment of each point, numbered from 0, independent of the order of the points.

        Args:
            points: (n, 3) points in W, where z = 0 is the top of the board [m].
            normals: (n, 3) outward unit normals in W.
            believed: (n,) the known fragment of each point, or `UNKNOWN`. Points with equal values stay together and
                points with different values stay apart; the first clusters are these values, ascending.
            expected: expected number of further clusters; None if it is not known. If it is known and `threshold` does
                not give it, each of `THRESHOLDS` is tried, starting with the nearest to `threshold`; the first that
                comes closest to the expected number is used.

        Raises:
            ValueError: there are fewer than two points.
        """
        if len(points) < 2:
            raise ValueError(f"{len(points)} points are too few to be segmented")
        thinned = thin(points, normals)
        known = np.unique(np.empty(0, np.int64) if believed is None else believed[believed != UNKNOWN])
        held = np.full(len(thinned.points), UNKNOWN)
        if believed is not None:
            held = _majority(thinned.cell_of, np.where(believed == UNKNOWN, UNKNOWN, np.searchsorted(known, believed)))
        edges, p = self.edge_probabilities(describe(thinned.points, thinned.normals))
        thresholds = [self.threshold]
        if expected is not None:
            thresholds += sorted(THRESHOLDS, key=lambda threshold: abs(threshold - self.threshold))
        labels, best_error = None, 0
        for threshold in thresholds:
            tried = grouped(thinned, edges, p, threshold, held, len(known))
            error = abs(int(tried.max()) + 1 - len(known) - (expected or 0))
            if labels is None or error < best_error:
                labels, best_error = tried, error
            if not best_error:
                break
        assert labels is not None
        if believed is not None:
            labels = np.where(believed == UNKNOWN, labels, np.searchsorted(known, believed))
        return np.asarray(labels, dtype=np.int64)

    def edge_probabilities(self, seen: Neighbourhoods) -> tuple[Ints, Floats]:
        """The edges (e, 2) between near points, and the probability (e,) that both ends belong to the same fragment."""
        h = np.maximum(self.describing(seen.points), 0.0)
        for number, (message, update) in enumerate(self.rounds):
            others, edges = (seen.near, seen.near_edges) if number % 2 else (seen.far, seen.far_edges)
            own = np.broadcast_to(h[:, None], (*others.shape, h.shape[1]))
            rows = np.concatenate([own, h[others], edges], axis=2).reshape(others.size, -1)
            messages = np.maximum(message(rows), 0.0).reshape(*others.shape, -1)
            h = h + update(np.concatenate([h, messages.mean(axis=1), messages.max(axis=1)], axis=1))
        first, column = np.nonzero(seen.lengths <= MAX_EDGE_LENGTH)
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
        """Serialise to the safetensors format."""
        parts = {"describing": self.describing}
        for i, (message, update) in enumerate(self.rounds):
            parts |= {f"message{i}": message, f"update{i}": update}
        others = {key: a for name, layers in parts.items() for key, a in named_arrays(layers, f"{name}.").items()}
        return to_bytes(self.judging, **others, threshold=np.array([self.threshold]))

    @staticmethod
    def from_bytes(data: bytes) -> "Segmentation":
        """The inverse of `to_bytes`.

        Raises:
            ValueError: the bytes are not a segmentation.
        """
        judging, others = from_bytes(data)
        rounds = sum(name.startswith("message") and name.endswith(".0.weight") for name in others)
        try:
            return Segmentation(
                from_named_arrays(others, "describing."),
                tuple(
                    (from_named_arrays(others, f"message{i}."), from_named_arrays(others, f"update{i}."))
                    for i in range(rounds)
                ),
                judging,
                number_in(others, "threshold", 0.0, 1.0),
            )
        except (KeyError, ValueError) as error:
            raise ValueError(f"not a segmentation ({error})") from None


def grouped(
    thinned: Thinned, edges: Ints, p: Floats, threshold: float, held: Ints | None = None, known: int = 0
) -> Ints:
    """(n,) the cluster of each point of a cloud, numbered from 0; the known fragments come first.

    Args:
        thinned: the cloud, thinned to m points.
        edges, p: (e, 2), (e,) result of `Segmentation.edge_probabilities`.
        threshold: minimum mean probability along a seam for two clusters to be merged.
        held: (m,) index of the known fragment of each thinned point, or `UNKNOWN`.
        known: number of known fragments.
    """
    held = np.full(len(thinned.points), UNKNOWN) if held is None else held
    node = np.where(held == UNKNOWN, known - 1 + np.cumsum(held == UNKNOWN), held)  # a known fragment is one node
    kinds = np.where(np.arange(int(node.max()) + 1) < known, np.arange(int(node.max()) + 1), UNKNOWN)
    between = node[edges]
    used = (between[:, 0] != between[:, 1]) & (between >= known).any(axis=1)
    labels = agglomerate(len(kinds), between[used], p[used], threshold, kinds)[node]
    return _absorb_small_clusters(thinned.points, labels, held, known)[thinned.cell_of]


def _majority(cell_of: Ints, believed: Ints) -> Ints:
    """(m,) the most frequent believed fragment of the points in each cell; the lowest index in case of a tie."""
    values, index = np.unique(believed, return_inverse=True)
    cells = int(cell_of.max()) + 1
    votes = np.bincount(cell_of * len(values) + index.ravel(), minlength=cells * len(values))
    return np.asarray(values[votes.reshape(cells, len(values)).argmax(axis=1)])


def _absorb_small_clusters(points: Floats, labels: Ints, held: Ints, known: int) -> Ints:
    """Renumber the clusters, `known` fragments first; points of small clusters go to the nearest other cluster."""
    believed = np.full(int(labels.max()) + 1, UNKNOWN)
    believed[labels[held != UNKNOWN]] = held[held != UNKNOWN]
    large = (np.bincount(labels) >= MIN_POINTS) | (believed != UNKNOWN)
    number = np.where(believed != UNKNOWN, believed, known - 1 + np.cumsum(large & (believed == UNKNOWN)))
    kept = large[labels]
    if not kept.any():  # too few points: a single cluster
        return np.zeros(len(labels), dtype=np.int64)
    renumbered = number[labels]
    if not kept.all():
        renumbered[~kept] = renumbered[kept][cKDTree(points[kept]).query(points[~kept])[1]]
    return np.asarray(renumbered)
