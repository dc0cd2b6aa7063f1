"""Agglomerative clustering of a graph whose edges have a probability that both ends belong together.

Every point starts as a cluster. The two clusters whose connecting edges have the highest mean probability are merged
repeatedly, until no mean is above a threshold. A single wrong edge, which would join two fragments in a connected
components algorithm, is outvoted by the other edges along the same seam. Ties are broken in a fixed order.
"""

import heapq

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints


def agglomerate(count: int, edges: Ints, probabilities: Floats, threshold: float, kinds: Ints | None = None) -> Ints:
    """(count,) cluster of each point, numbered from 0 by the lowest index of their points.

    Args:
        count: number of points.
        edges: (e, 2) the indices of the ends of every edge.
        probabilities: (e,) probability that the ends belong together.
        threshold: minimum mean probability of the edges between two clusters that are merged.
        kinds: (count,) clusters that contain points of different kinds are not merged; negative means no kind.
    """
    kind = [-1] * count if kinds is None else kinds.tolist()
    between: list[dict[int, tuple[float, int]]] = [{} for _ in range(count)]
    for (a, b), p in zip(edges.tolist(), probabilities.tolist(), strict=True):
        total, number = between[a].get(b, (0.0, 0))
        between[a][b] = between[b][a] = (total + p, number + 1)
    heap = [(-s / n, a, b, n) for a, others in enumerate(between) for b, (s, n) in others.items() if a < b]
    heapq.heapify(heap)
    members = [[i] for i in range(count)]
    while heap:
        negative, a, b, number = heapq.heappop(heap)
        if -negative < threshold:
            break
        entry = between[a].get(b) if members[a] and members[b] else None
        if entry is None or entry[1] != number or -entry[0] / number != negative:
            continue  # outdated: one of the clusters has changed
        if kind[a] != kind[b] and min(kind[a], kind[b]) >= 0:
            continue
        if len(between[a]) < len(between[b]):
            a, b = b, a
        members[a] += members[b]
        members[b] = []
        kind[a] = max(kind[a], kind[b])
        del between[a][b], between[b][a]
        for other, (total, n_edges) in between[b].items():
            del between[other][b]
            other_total, n_other_edges = between[a].get(other, (0.0, 0))
            total, n_edges = total + other_total, n_edges + n_other_edges
            between[a][other] = between[other][a] = (total, n_edges)
            heapq.heappush(heap, (-total / n_edges, min(a, other), max(a, other), n_edges))
        between[b] = {}
    labels = np.empty(count, dtype=np.int64)
    for number, cluster in enumerate(sorted((min(cluster), cluster) for cluster in members if cluster)):
        labels[cluster[1]] = number
    return labels
