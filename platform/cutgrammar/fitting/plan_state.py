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

from cutgrammar.fitting.principal_frame import moments, principal_axes, principal_deviations
from cutgrammar.fitting.virtual_overlap import FEW, MARGIN, box_overlap, virtual_iou
from cutgrammar.geometry.arrays import Floats, Ints

NONE = -1
"""No node, or no goal fragment."""
WORTH_COMPARING = 0.4
"""Pairs of a leaf and a goal fragment whose IoU cannot reach this are not compared to find the best grounding."""
RANKED = 128
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
        points: (p, 3) sample points, permuted, each in C of its current fragment [m]; an array in Fortran's order.
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
    points: NDArray[np.float32]
    keys: NDArray[np.uint32]
    weight: Floats


class Scratch(NamedTuple):
    """Working memory of the compiled functions, and what a move asks to be cut again.

    Attributes:
        chosen, others: (p + 1,) indices of points.
        local: (2, 3, p) coordinates of points in a terminal's frame.
        heights: (p,) heights of points above a plane.
        stack: (n + 1,) nodes still to be visited, or listed.
        leaves: (n,) leaves to be scored.
        redo: (n,) what happens to the plane of a node that is cut again: `KEEP`, `SHIFT` or `DRAW`.
        tops: (2,) nodes below which is cut again.
        compared: (1,) number of points that are compared with a target; 0: deviations are.
        centres, covariances, deviations: (n, 3), (n, 3, 3), (n, 3) of the points of leaves that were measured last.
        frame: (3, 3) principal axes of the leaf that is compared.
    """

    chosen: NDArray[np.int32]
    others: NDArray[np.int32]
    local: NDArray[np.float32]
    heights: NDArray[np.float32]
    stack: Ints
    leaves: Ints
    redo: NDArray[np.int8]
    tops: Ints
    compared: Ints
    centres: Floats
    covariances: Floats
    deviations: Floats
    frame: Floats


KEEP, SHIFT, DRAW = 0, 1, 2
"""A plane stays, is shifted so that its sides get the volumes they want, or gets a new normal and is then shifted."""


def scratch_for(state: PlanState, compared: int) -> Scratch:
    """Working memory for a plan whose terminals are scored by so many points."""
    n, p = len(state.left), len(state.points)
    return Scratch(
        np.empty(p + 1, np.int32),
        np.empty(p + 1, np.int32),
        np.empty((2, 3, p), np.float32),
        np.empty(p, np.float32),
        np.empty(n + 1, np.int64),
        np.empty(n, np.int64),
        np.zeros(n, np.int8),
        np.zeros(2, np.int64),
        np.array([compared]),
        np.empty((n, 3)),
        np.empty((n, 3, 3)),
        np.empty((n, 3)),
        np.empty((3, 3)),
    )


def duplicate(state: PlanState) -> PlanState:
    """A copy that shares nothing."""
    return PlanState._make(array.copy(order="K") for array in state)


@njit(cache=True)
def list_below(state, scratch, top):  # type: ignore[no-untyped-def]
    """Write the nodes at or below `top`, parents before children, to `scratch.stack`; return their number."""
    nodes = scratch.stack
    nodes[0], n = top, 1
    i = 0
    while i < n:
        if state.left[nodes[i]] != NONE:
            nodes[n], nodes[n + 1] = state.left[nodes[i]], state.right[nodes[i]]
            n += 2
        i += 1
    return n


@njit(cache=True, fastmath=True)
def partition(state, scratch, node):  # type: ignore[no-untyped-def]
    """Divide the points of an inner node among its children by its plane.

    Points on the wrong side change places in pairs. No branch depends on a point, so that the time does not depend on
    how many there are. Indices are unsigned where a loop shall become vector instructions: numba checks for negative
    ones.
    """
    first, last = state.first[node], state.last[node]
    n = last - first
    heights, low, high = scratch.heights, scratch.chosen, scratch.others
    points, keys, plane = state.points, state.keys, state.planes[node]
    a, b, c, d = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2]), np.float32(plane[3])
    below = 0
    for i in range(n):
        p = np.uint64(first + i)
        heights[i] = a * points[p, 0] + b * points[p, 1] + c * points[p, 2] + d
    for i in range(n):
        below += heights[i] < 0.0
    m, k = 0, 0
    for i in range(below):
        low[m] = first + i
        m += heights[i] >= 0.0
    for i in range(below, n):
        high[k] = first + i
        k += heights[i] < 0.0
    for axis in range(3):
        for q in range(m):
            i, j = low[q], high[q]
            points[i, axis], points[j, axis] = points[j, axis], points[i, axis]
    for q in range(m):
        i, j = low[q], high[q]
        keys[i], keys[j] = keys[j], keys[i]
    left, right = state.left[node], state.right[node]
    state.first[left], state.last[left] = first, first + below
    state.first[right], state.last[right] = first + below, last


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
    points, plane, heights = state.points, state.planes[node], scratch.heights
    a, b, c = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2])
    for i in range(n):
        p = first + i * stride
        heights[i] = a * points[p, 0] + b * points[p, 1] + c * points[p, 2]
    highest_below = _select(heights, n, below - 1)
    lowest_above = heights[below]
    for i in range(below + 1, n):
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
            while values[np.uint64(i)] < pivot:
                i += 1
            while values[np.uint64(j)] > pivot:
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
def points_key(state, leaf):  # type: ignore[no-untyped-def]
    """A number by which equal sets of points are recognised."""
    key = np.uint64(state.last[leaf] - state.first[leaf])
    keys = state.keys
    for i in range(state.first[leaf], state.last[leaf]):
        key += keys[np.uint64(i)]
    return key


@njit(cache=True)
def measure(state, scratch, leaf):  # type: ignore[no-untyped-def]
    """Compute centroid, covariance and deviations of a leaf's points into `scratch`; False if they are too few."""
    first, last = state.first[leaf], state.last[leaf]
    if last - first < FEW:
        return False
    moments(state.points, first, last, scratch.centres[leaf], scratch.covariances[leaf])
    principal_deviations(scratch.covariances[leaf], scratch.deviations[leaf])
    return True


@njit(cache=True)
def most_iou(state, targets, scratch, leaf, goal):  # type: ignore[no-untyped-def]
    """Upper bound of the IoU of a leaf that was measured with a goal fragment: by volumes, and by deviations."""
    have = (state.last[leaf] - state.first[leaf]) * state.weight[state.root[leaf]]
    want = targets.volumes[goal]
    box = box_overlap(scratch.deviations[leaf], targets.deviations[goal]) + MARGIN
    return min(min(have, want) / max(have, want), box)


@njit(cache=True)
def leaf_iou(state, targets, scratch, leaf, goal):  # type: ignore[no-untyped-def]
    """IoU of a leaf that was measured with a goal fragment; by deviations alone if no points are compared."""
    if scratch.compared[0] == 0:
        return min(most_iou(state, targets, scratch, leaf, goal), 1.0) - MARGIN
    principal_axes(scratch.covariances[leaf], scratch.frame)
    return virtual_iou(
        state.points,
        state.keys,
        state.first[leaf],
        state.last[leaf],
        scratch.centres[leaf],
        scratch.frame,
        state.weight[state.root[leaf]],
        targets.grids[goal],
        targets.cells[goal],
        targets.volumes[goal],
        scratch.chosen,
        scratch.local,
        scratch.compared[0],
    )


@njit(cache=True)
def score_leaves(state, targets, scratch, n, needed):  # type: ignore[no-untyped-def]
    """Score the first n of `scratch.leaves`, which were measured and have the most that their IoU can be.

    It stops as soon as the sum of all leaves can hardly reach `needed`.

    Returns:
        The sum of the IoU of all leaves, or -1 if it stopped.
    """
    bound = total_iou(state)
    for i in range(n):
        if bound < needed:
            return -1.0
        leaf = scratch.leaves[i]
        if state.iou[leaf] == 0.0:
            continue
        iou = leaf_iou(state, targets, scratch, leaf, state.goal[leaf])
        bound += iou - state.iou[leaf]
        state.iou[leaf] = iou
    return total_iou(state) if bound >= needed else -1.0


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
    """(leaves, g) IoU of every leaf, in the order of nodes, with every goal fragment; of poor pairs a lower bound."""
    leaves = np.flatnonzero(state.goal != NONE)
    table = np.zeros((len(leaves), len(targets.volumes)))
    for row in range(len(leaves)):
        if not measure(state, scratch, leaves[row]):
            continue
        for goal in range(len(targets.volumes)):
            most = most_iou(state, targets, scratch, leaves[row], goal)
            if most < WORTH_COMPARING and goal != state.goal[leaves[row]]:
                table[row, goal] = max(most - 2.0 * MARGIN, 0.0)
            else:
                table[row, goal] = leaf_iou(state, targets, scratch, leaves[row], goal)
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
