"""Clusters of a graph whose edges tell how probably their ends belong together.

Every point begins as a cluster of its own. The two clusters whose edges have the highest mean probability are made one,
again and again, until none is above a threshold. A single wrong edge, which would join two fragments in a search for
connected components, is thus outvoted by the others along the same seam. Equal means are taken in a fixed order.
"""

import heapq

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints


def agglomerate(count: int, edges: Ints, probabilities: Floats, threshold: float, kinds: Ints | None = None) -> Ints:
    """(count,) cluster of each point, numbered from 0 in the order of their first points.

    Args:
        count: number of points.
        edges: (e, 2) the points that each edge joins.
        probabilities: (e,) that they belong together.
        threshold: mean probability of the edges between two clusters below which they stay apart.
        kinds: (count,) clusters with points of two different kinds stay apart; a negative number is no kind.
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
            continue  # the two have changed since
        if kind[a] != kind[b] and min(kind[a], kind[b]) >= 0:
            continue
        if len(between[a]) < len(between[b]):
            a, b = b, a
        members[a] += members[b]
        members[b] = []
        kind[a] = max(kind[a], kind[b])
        del between[a][b], between[b][a]
        for other, (total, edges_there) in between[b].items():
            del between[other][b]
            known, known_edges = between[a].get(other, (0.0, 0))
            total, edges_there = total + known, edges_there + known_edges
            between[a][other] = between[other][a] = (total, edges_there)
            heapq.heappush(heap, (-total / edges_there, min(a, other), max(a, other), edges_there))
        between[b] = {}
    labels = np.empty(count, dtype=np.int64)
    for number, cluster in enumerate(sorted((min(cluster), cluster) for cluster in members if cluster)):
        labels[cluster[1]] = number
    return labels
