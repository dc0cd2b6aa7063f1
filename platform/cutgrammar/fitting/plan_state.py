"""A plan under fitting, as arrays for compiled code, and virtual cutting: sample points divided along a tree of planes.

A plan has one tree for each current fragment. An inner node has a plane and two children: `left` below the plane and
`right` above it. A leaf has one of the goal's fragments, which it shall become. The points of a fragment are stored
together, and those of every node are a range of them, so that cutting again below a node only permutes its own range.
Planes are in the canonical frame C of the current fragment.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cutgrammar.fitting.virtual_overlap import virtual_iou
from cutgrammar.geometry.arrays import Floats, Ints

NONE = -1
"""No node, or no goal fragment."""
RANKED = 400
"""About as many points are ranked to find the offset of a plane that divides volumes as wanted."""
UNSCORED = np.uint64(2**64 - 1)
"""Key of a leaf that has to be scored whatever its points are."""


class PlanState(NamedTuple):
    """A plan and its evaluation; all arrays over nodes have one entry for each of n nodes, roots first.

    Attributes:
        left, right, parent: indices of nodes, or `NONE`.
        root: index of the current fragment that the node belongs to, which is also its root's index.
        goal: goal fragment of a leaf; `NONE` for inner nodes.
        planes: (n, 4) normal and offset of inner nodes, in C of the current fragment [m].
        wanted: volume of the goal's fragments at or below the node [m3].
        first, last: range of the node's points.
        key: sum of the keys of the points of a leaf, by which equal sets are recognised.
        iou: of each leaf with its goal fragment.
        points: (p, 3) sample points, permuted, each in C of its current fragment [m].
        keys: (p,) random key of every point, permuted alike.
        weight: volume that a point of each root stands for [m3].
    """

    left: Ints
    right: Ints
    parent: Ints
    root: Ints
    goal: Ints
    planes: Floats
    wanted: Floats
    first: Ints
    last: Ints
    key: NDArray[np.uint64]
    iou: Floats
    points: Floats
    keys: NDArray[np.uint64]
    weight: Floats


class Scratch(NamedTuple):
    """Working memory of the compiled functions: a copy of the points, of their coordinates, and a stack of nodes."""

    points: Floats
    keys: NDArray[np.uint64]
    local: Floats
    heights: Floats
    stack: Ints


def scratch_for(state: PlanState) -> Scratch:
    """Working memory for a plan."""
    n = len(state.points)
    return Scratch(
        np.empty((n, 3)), np.empty(n, np.uint64), np.empty((n, 3)), np.empty(n), np.empty(len(state.left) + 1, np.int64)
    )


@njit(cache=True)
def partition(state, node):  # type: ignore[no-untyped-def]
    """Divide the points of an inner node among its children by its plane."""
    a, b, c, d = state.planes[node, 0], state.planes[node, 1], state.planes[node, 2], state.planes[node, 3]
    points, keys = state.points, state.keys
    i, j = state.first[node], state.last[node] - 1
    while i <= j:
        if a * points[i, 0] + b * points[i, 1] + c * points[i, 2] + d < 0.0:
            i += 1
        else:
            for axis in range(3):
                points[i, axis], points[j, axis] = points[j, axis], points[i, axis]
            keys[i], keys[j] = keys[j], keys[i]
            j -= 1
    left, right = state.left[node], state.right[node]
    state.first[left], state.last[left] = state.first[node], i
    state.first[right], state.last[right] = i, state.last[node]


@njit(cache=True)
def cut_below(state, targets, scratch, top):  # type: ignore[no-untyped-def]
    """Cut virtually below `top` with the planes as they are; leaves whose points are as before are not scored again."""
    stack = scratch.stack
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] == NONE:
            score_leaf(state, targets, scratch, node)
        else:
            partition(state, node)
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2


@njit(cache=True)
def cut_to_volumes(state, targets, scratch, top):  # type: ignore[no-untyped-def]
    """Cut below `top`, keeping the normals but shifting each plane so that its sides get the volumes they want."""
    stack = scratch.stack
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] == NONE:
            score_leaf(state, targets, scratch, node)
        else:
            shift_to_volumes(state, scratch, node)
            partition(state, node)
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2


@njit(cache=True)
def shift_to_volumes(state, scratch, node):  # type: ignore[no-untyped-def]
    """Set the offset of a node's plane so that its sides' volumes are in proportion to those wanted."""
    first, last = state.first[node], state.last[node]
    stride = max((last - first) // RANKED, 1)
    n = (last - first + stride - 1) // stride
    if n < 2:
        return
    share = state.wanted[state.left[node]] / state.wanted[node]
    below = min(max(int(share * n + 0.5), 1), n - 1)
    a, b, c = state.planes[node, 0], state.planes[node, 1], state.planes[node, 2]
    heights = scratch.heights
    for i in range(n):
        p = first + i * stride
        heights[i] = a * state.points[p, 0] + b * state.points[p, 1] + c * state.points[p, 2]
    highest_below = _select(heights, n, below - 1)
    lowest_above = np.inf
    for i in range(below, n):
        lowest_above = min(lowest_above, heights[i])
    state.planes[node, 3] = -0.5 * (highest_below + lowest_above)


@njit(cache=True)
def _select(values, n, k):  # type: ignore[no-untyped-def]
    """The k-th smallest of values[:n]; smaller ones come to stand before it, larger ones after it."""
    low, high = 0, n - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return values[k]


@njit(cache=True)
def score_leaf(state, targets, scratch, leaf):  # type: ignore[no-untyped-def]
    """Score a leaf against its goal fragment unless its points are as before."""
    first, last = state.first[leaf], state.last[leaf]
    key = np.uint64(last - first)
    for i in range(first, last):
        key += state.keys[i]
    if key == state.key[leaf]:
        return
    state.key[leaf] = key
    goal = state.goal[leaf]
    state.iou[leaf] = virtual_iou(
        state.points,
        state.keys,
        first,
        last,
        state.weight[state.root[leaf]],
        targets.grids[goal],
        targets.cells[goal],
        targets.volumes[goal],
        scratch.local,
    )


@njit(cache=True)
def total_iou(state):  # type: ignore[no-untyped-def]
    """Sum of the IoU of all leaves."""
    total = 0.0
    for node in range(len(state.left)):
        if state.goal[node] != NONE:
            total += state.iou[node]
    return total


@njit(cache=True)
def iou_table(state, targets, scratch):  # type: ignore[no-untyped-def]
    """(leaves, g) IoU of every leaf, in the order of nodes, with every goal fragment."""
    leaves = np.flatnonzero(state.goal != NONE)
    table = np.zeros((len(leaves), len(targets.volumes)))
    for row in range(len(leaves)):
        leaf = leaves[row]
        first, last = state.first[leaf], state.last[leaf]
        weight = state.weight[state.root[leaf]]
        volume = (last - first) * weight
        for goal in range(len(targets.volumes)):
            other = targets.volumes[goal]
            if min(volume, other) < 0.4 * max(volume, other):
                table[row, goal] = 1e-3 * min(volume, other) / max(volume, other)
                continue
            table[row, goal] = virtual_iou(
                state.points,
                state.keys,
                first,
                last,
                weight,
                targets.grids[goal],
                targets.cells[goal],
                other,
                scratch.local,
            )
    return table


@njit(cache=True)
def add_up_wanted(state, volumes):  # type: ignore[no-untyped-def]
    """Recompute the volume wanted of every node from the goals of the leaves."""
    state.wanted[:] = 0.0
    for leaf in range(len(state.left)):
        if state.goal[leaf] != NONE:
            node = leaf
            while node != NONE:
                state.wanted[node] += volumes[state.goal[leaf]]
                node = state.parent[node]
