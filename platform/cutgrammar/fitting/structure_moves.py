"""Changes of a plan's trees (see `node_choice`).

They shift the planes below to the volumes then wanted, because with planes that stay no exchange of unequal fragments
could ever pay.
"""

import numpy as np
from numba import njit

from cutgrammar.fitting.node_choice import (
    common_ancestor,
    cut_at,
    inner_node,
    mark_below,
    partner,
    poor_leaf,
    shift_all,
)
from cutgrammar.fitting.plan_state import DRAW, NONE, SHIFT, UNSCORED, add_up_wanted, list_below
from cutgrammar.inference.draws import below, uniform


@njit(cache=True)
def replace_child(state, parent, old, new):  # type: ignore[no-untyped-def]
    """Put `new` in the place of the child `old` of `parent`."""
    if state.left[parent] == old:
        state.left[parent] = new
    else:
        state.right[parent] = new
    state.parent[new] = parent


@njit(cache=True)
def set_root(state, scratch, top, root):  # type: ignore[no-untyped-def]
    """Note for all nodes below `top` that they belong to the fragment `root`."""
    for i in range(list_below(state, scratch, top)):
        state.root[scratch.stack[i]] = root
        state.key[scratch.stack[i]] = UNSCORED


@njit(cache=True)
def swap_subtrees(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Exchange two subtrees, neither of which contains the other."""
    a = below(rng, len(state.left))
    b = partner(state, a, rng, False)
    if b == NONE or state.parent[a] == NONE or state.parent[b] == NONE or state.parent[a] == state.parent[b]:
        return 0
    common = common_ancestor(state, a, b)
    if common in (a, b):
        return 0
    parent_a, parent_b = state.parent[a], state.parent[b]
    replace_child(state, parent_a, a, b)
    replace_child(state, parent_b, b, a)
    root_a, root_b = state.root[a], state.root[b]
    if root_a != root_b:
        set_root(state, scratch, a, root_b)
        set_root(state, scratch, b, root_a)
    return shift_all(state, targets, scratch, parent_a, parent_b)


@njit(cache=True)
def mirror(state, scratch, rng):  # type: ignore[no-untyped-def]
    """Exchange the sides of one plane, and with a probability of one half of all planes below."""
    top = inner_node(state, rng)
    if top == NONE:
        return 0
    mark_below(state, scratch, top, SHIFT)
    if uniform(rng) < 0.5:
        state.left[top], state.right[top] = state.right[top], state.left[top]
        return cut_at(scratch, top)
    stack = scratch.stack
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] != NONE:
            state.left[node], state.right[node] = state.right[node], state.left[node]
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2
    return cut_at(scratch, top)


@njit(cache=True)
def rotate(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Make a child's plane the one that is cut first: a rotation of the tree, for planes that do not cross."""
    node = inner_node(state, rng)
    if node == NONE:
        return 0
    from_left = uniform(rng) < 0.5
    child = state.left[node] if from_left else state.right[node]
    if state.left[child] == NONE:
        return 0
    # The nodes keep their places in the tree, so that a root stays a root; their planes are exchanged.
    x, y = state.left[child], state.right[child]
    other = state.right[node] if from_left else state.left[node]
    same = 0.0
    for axis in range(3):
        same += state.planes[node, axis] * state.planes[child, axis]
    for axis in range(4):
        state.planes[node, axis], state.planes[child, axis] = state.planes[child, axis], state.planes[node, axis]
    if from_left and same >= 0.0:  # ((x y) other) -> (x (y other))
        state.left[node], state.right[node], state.left[child], state.right[child] = x, child, y, other
    elif from_left:  # the planes face each other: -> ((x other) y)
        state.left[node], state.right[node], state.left[child], state.right[child] = child, y, x, other
    elif same >= 0.0:  # (other (x y)) -> ((other x) y)
        state.left[node], state.right[node], state.left[child], state.right[child] = child, y, other, x
    else:
        state.left[node], state.right[node], state.left[child], state.right[child] = x, child, other, y
    for parent in (node, child):
        state.parent[state.left[parent]] = parent
        state.parent[state.right[parent]] = parent
    add_up_wanted(state, targets.volumes)
    mark_below(state, scratch, node, SHIFT)
    return cut_at(scratch, node)


@njit(cache=True)
def transpose(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Cut first by what were the planes of both children: ((a b) (c d)) -> ((a c) (b d)), for planes that cross.

    Fragments of a grid can be cut row by row or column by column; both are the same fragments in another tree.
    """
    node = inner_node(state, rng)
    if node == NONE:
        return 0
    left, right = state.left[node], state.right[node]
    if state.left[left] == NONE or state.left[right] == NONE:
        return 0
    a, b, c, d = state.left[left], state.right[left], state.left[right], state.right[right]
    same = 0.0
    for axis in range(3):
        same += state.planes[left, axis] * state.planes[right, axis]
    sign = 1.0
    if same < 0.0:
        sign = -1.0
        c, d = d, c
    length = 0.0
    for axis in range(3):
        mean = 0.5 * (state.planes[left, axis] + sign * state.planes[right, axis])
        length += mean * mean
    length = np.sqrt(length)
    for axis in range(4):
        mean = 0.5 * (state.planes[left, axis] + sign * state.planes[right, axis]) / length
        state.planes[left, axis] = state.planes[right, axis] = state.planes[node, axis]
        state.planes[node, axis] = mean
    state.left[left], state.right[left], state.left[right], state.right[right] = a, c, b, d
    for parent in (left, right):
        state.parent[state.left[parent]] = parent
        state.parent[state.right[parent]] = parent
    add_up_wanted(state, targets.volumes)
    if uniform(rng) < 0.7:
        mark_below(state, scratch, node, SHIFT)
    return cut_at(scratch, node)


@njit(cache=True)
def _take_over(state, node, other):  # type: ignore[no-untyped-def]
    """Let `node` have plane, children and goal of `other`."""
    state.left[node], state.right[node], state.goal[node] = state.left[other], state.right[other], state.goal[other]
    state.key[node] = UNSCORED
    for axis in range(4):
        state.planes[node, axis] = state.planes[other, axis]
    if state.left[node] != NONE:
        state.parent[state.left[node]] = node
        state.parent[state.right[node]] = node


@njit(cache=True)
def transplant(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Take a subtree out and cut it off another node, along an axis or parallel to another plane."""
    n = len(state.left)
    moved = below(rng, n) if uniform(rng) < 0.3 else poor_leaf(state, rng)
    joint = state.parent[moved]
    if joint == NONE:
        return 0
    sibling = state.left[joint] if state.right[joint] == moved else state.right[joint]
    place = below(rng, n)
    if place in (joint, sibling) or common_ancestor(state, moved, place) == moved:
        return 0
    old_root, new_root = state.root[joint], state.root[place]
    above = state.parent[joint]
    if above == NONE:
        # A root keeps its index: what the sibling holds moves up into it, and the sibling's index is free.
        _take_over(state, joint, sibling)
        joint, sibling = sibling, joint
    else:
        replace_child(state, above, joint, sibling)
        state.first[sibling], state.last[sibling] = state.first[joint], state.last[joint]
    state.goal[joint] = NONE
    # Now `joint` is free and becomes the parent of `moved` and of what was at `place`.
    parent = state.parent[place]
    if parent == NONE:
        _take_over(state, joint, place)
        state.root[joint], state.goal[place] = place, NONE
        joint, place = place, joint
    else:
        replace_child(state, parent, place, joint)
        state.first[joint], state.last[joint] = state.first[place], state.last[place]
    if uniform(rng) < 0.5:
        state.left[joint], state.right[joint] = moved, place
    else:
        state.left[joint], state.right[joint] = place, moved
    state.parent[moved] = state.parent[place] = joint
    state.root[joint] = new_root
    if old_root != new_root:
        set_root(state, scratch, moved, new_root)
    n_tops = shift_all(state, targets, scratch, sibling, joint)
    scratch.redo[joint] = DRAW
    return n_tops
