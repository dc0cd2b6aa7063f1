"""Changes of a plan that keep its tree: of planes and of the grounding of its terminals (see `node_choice`)."""

import numpy as np
from numba import njit

from cutgrammar.fitting.node_choice import cut_at, inner_node, mark_below, partner, poor_leaf, shift_all
from cutgrammar.fitting.plan_state import DRAW, NONE, SHIFT, UNSCORED, add_up_wanted
from cutgrammar.inference.draws import below, uniform

TURN, STEP = 0.6, 0.5
"""Largest scale of a turn [rad] and of a shift, in standard deviations of the points along the normal."""
DECADES = 2.5
"""Steps are spread evenly in the logarithm over this many powers of ten."""
LOOKED_AT = 100
"""About as many points give the centre of a node and its spread along a normal."""
REGROWN = 8
"""Largest number of leaves of a subtree that is grown anew."""


@njit(cache=True)
def normal_number(rng):  # type: ignore[no-untyped-def]
    """Draw a standard normal number."""
    return np.sqrt(-2.0 * np.log(1.0 - uniform(rng))) * np.cos(2.0 * np.pi * uniform(rng))


@njit(cache=True)
def move_plane(state, scratch, rng):  # type: ignore[no-untyped-def]
    """Turn and shift one plane by a step of random scale."""
    node = inner_node(state, rng)
    if node == NONE or state.last[node] - state.first[node] < 2:
        return 0
    scale = 10.0 ** (-DECADES * uniform(rng))
    plane = state.planes[node]
    first, last = state.first[node], state.last[node]
    stride = max((last - first) // LOOKED_AT, 1)
    n = (last - first + stride - 1) // stride
    x = y = z = 0.0
    for i in range(first, last, stride):
        x += state.points[i, 0]
        y += state.points[i, 1]
        z += state.points[i, 2]
    x, y, z = x / n, y / n, z / n
    # The plane turns about its point nearest to the centroid of the node.
    away = plane[0] * x + plane[1] * y + plane[2] * z + plane[3]
    px, py, pz = x - away * plane[0], y - away * plane[1], z - away * plane[2]
    kind = uniform(rng)
    if kind < 0.75:
        a = plane[0] + TURN * scale * normal_number(rng)
        b = plane[1] + TURN * scale * normal_number(rng)
        c = plane[2] + TURN * scale * normal_number(rng)
        length = np.sqrt(a * a + b * b + c * c)
        if length < 1e-6:
            return 0
        plane[0], plane[1], plane[2] = a / length, b / length, c / length
        plane[3] = -(plane[0] * px + plane[1] * py + plane[2] * pz)
    if kind > 0.4:
        spread = 0.0
        for i in range(first, last, stride):
            h = plane[0] * (state.points[i, 0] - x) + plane[1] * (state.points[i, 1] - y)
            h += plane[2] * (state.points[i, 2] - z)
            spread += h * h
        plane[3] += STEP * scale * np.sqrt(spread / n) * normal_number(rng)
    if uniform(rng) < 0.25:
        scratch.redo[node] = SHIFT
    return cut_at(scratch, node)


@njit(cache=True)
def align_plane(state, scratch, rng):  # type: ignore[no-untyped-def]
    """Draw a new normal for one plane; the planes below are shifted or stay."""
    node = inner_node(state, rng)
    if node == NONE:
        return 0
    if uniform(rng) < 0.5:
        mark_below(state, scratch, node, SHIFT)
    scratch.redo[node] = DRAW
    return cut_at(scratch, node)


@njit(cache=True)
def swap_goals(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Exchange the goal fragments of two leaves, with the planes as they are or shifted to the volumes."""
    a = poor_leaf(state, rng)
    b = partner(state, a, rng, True)
    if b == NONE:
        return 0
    state.goal[a], state.goal[b] = state.goal[b], state.goal[a]
    state.key[a] = state.key[b] = UNSCORED
    if uniform(rng) < 0.5:
        add_up_wanted(state, targets.volumes)
        scratch.tops[0], scratch.tops[1] = a, b
        return 2
    return shift_all(state, targets, scratch, a, b)


@njit(cache=True)
def regrow(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Draw all normals of a small subtree anew, and mostly shuffle its goal fragments."""
    top = inner_node(state, rng)
    if top == NONE:
        return 0
    leaves, stack = scratch.leaves, scratch.stack
    stack[0], n, m = top, 1, 0
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] == NONE:
            leaves[m] = node
            m += 1
        else:
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2
    if m > REGROWN:
        return 0
    if uniform(rng) < 0.7:
        for i in range(m - 1, 0, -1):
            j = below(rng, i + 1)
            a, b = leaves[i], leaves[j]
            state.goal[a], state.goal[b] = state.goal[b], state.goal[a]
        for i in range(m):
            state.key[leaves[i]] = UNSCORED
        add_up_wanted(state, targets.volumes)
    mark_below(state, scratch, top, DRAW)
    return cut_at(scratch, top)
