"""Changes of a plan that fitting tries: of planes, of the grounding of terminals, and of the structure.

Every move changes the arrays of a `PlanState` and cuts virtually what it has changed. It returns the node below which
points may have moved, the number of nodes for the whole plan, or `NONE` if it does not apply. Moves of structure and
grounding shift the planes below to the volumes then wanted, because with planes that stay no exchange of unequal
fragments could ever pay.
"""

import numpy as np
from numba import njit

from cutgrammar.fitting.plan_state import (
    NONE,
    UNSCORED,
    add_up_wanted,
    cut_below,
    cut_to_volumes,
    shift_to_volumes,
)
from cutgrammar.fitting.virtual_overlap import principal_frame
from cutgrammar.inference.draws import below, uniform

TURN, SHIFT = 0.6, 0.5
"""Largest scale of a turn [rad] and of a shift, in standard deviations of the points along the normal."""
SIMILAR = 0.15
"""Nodes whose wanted volumes differ by this log ratio are exchanged half as often as those of equal volumes."""
DECADES = 2.5
"""Steps are spread evenly in the logarithm over this many powers of ten."""


@njit(cache=True)
def normal_number(rng):  # type: ignore[no-untyped-def]
    """Draw a standard normal number."""
    return np.sqrt(-2.0 * np.log(1.0 - uniform(rng))) * np.cos(2.0 * np.pi * uniform(rng))


@njit(cache=True)
def inner_node(state, rng):  # type: ignore[no-untyped-def]
    """Draw an inner node; `NONE` if there is none."""
    n = len(state.left)
    inner = 0
    for node in range(n):
        inner += state.left[node] != NONE
    if inner == 0:
        return NONE
    chosen = below(rng, inner)
    for node in range(n):
        if state.left[node] != NONE:
            if chosen == 0:
                return node
            chosen -= 1
    return NONE


@njit(cache=True)
def leaf_node(state, rng):  # type: ignore[no-untyped-def]
    """Draw a leaf."""
    n = len(state.left)
    while True:
        node = below(rng, n)
        if state.goal[node] != NONE:
            return node


@njit(cache=True)
def partner(state, node, rng, leaves_only):  # type: ignore[no-untyped-def]
    """Draw another node, the more readily the closer its wanted volume is to that of `node`."""
    for _ in range(20):
        other = leaf_node(state, rng) if leaves_only else below(rng, len(state.left))
        if other == node:
            continue
        unlike = abs(np.log(state.wanted[other] / state.wanted[node])) / SIMILAR
        if uniform(rng) < 1.0 / (1.0 + unlike * unlike):
            return other
    return NONE


@njit(cache=True)
def move_plane(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Turn and shift one plane by a step of random scale."""
    node = inner_node(state, rng)
    if node == NONE or state.last[node] - state.first[node] < 2:
        return NONE
    scale = 10.0 ** (-DECADES * uniform(rng))
    plane = state.planes[node]
    first, last = state.first[node], state.last[node]
    # the plane turns about its point nearest to the centroid of the node
    x = y = z = 0.0
    for i in range(first, last):
        x += state.points[i, 0]
        y += state.points[i, 1]
        z += state.points[i, 2]
    n = last - first
    x, y, z = x / n, y / n, z / n
    away = plane[0] * x + plane[1] * y + plane[2] * z + plane[3]
    px, py, pz = x - away * plane[0], y - away * plane[1], z - away * plane[2]
    kind = uniform(rng)
    if kind < 0.75:
        tx, ty, tz = normal_number(rng), normal_number(rng), normal_number(rng)
        a, b, c = plane[0] + TURN * scale * tx, plane[1] + TURN * scale * ty, plane[2] + TURN * scale * tz
        length = np.sqrt(a * a + b * b + c * c)
        if length < 1e-6:
            return NONE
        plane[0], plane[1], plane[2] = a / length, b / length, c / length
        plane[3] = -(plane[0] * px + plane[1] * py + plane[2] * pz)
    if kind > 0.4:
        spread = 0.0
        for i in range(first, last):
            h = plane[0] * (state.points[i, 0] - x) + plane[1] * (state.points[i, 1] - y)
            h += plane[2] * (state.points[i, 2] - z)
            spread += h * h
        plane[3] += SHIFT * scale * np.sqrt(spread / n) * normal_number(rng)
    if uniform(rng) < 0.25:
        shift_to_volumes(state, scratch, node)
    cut_below(state, targets, scratch, node)
    return node


@njit(cache=True)
def draw_normal(state, node, rng):  # type: ignore[no-untyped-def]
    """A new normal for a node: that of another plane of the same fragment, or a principal axis of its points."""
    plane = state.planes[node]
    if uniform(rng) < 0.5:
        other = inner_node(state, rng)
        if other != NONE and other != node and state.root[other] == state.root[node]:
            sign = 1.0 if uniform(rng) < 0.5 else -1.0
            for axis in range(3):
                plane[axis] = sign * state.planes[other, axis]
            return
    centre, axes = np.empty(3), np.empty((3, 3))
    if state.last[node] - state.first[node] > 3:
        principal_frame(state.points, state.first[node], state.last[node], centre, axes)
    else:
        axes[:] = np.eye(3)
    column = below(rng, 3)
    sign = 1.0 if uniform(rng) < 0.5 else -1.0
    for axis in range(3):
        plane[axis] = sign * axes[axis, column]


@njit(cache=True)
def align_plane(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Give one plane a new normal and the volumes wanted; the planes below follow or stay."""
    node = inner_node(state, rng)
    if node == NONE or state.last[node] - state.first[node] < 2:
        return NONE
    draw_normal(state, node, rng)
    if uniform(rng) < 0.5:
        cut_to_volumes(state, targets, scratch, node)
    else:
        shift_to_volumes(state, scratch, node)
        cut_below(state, targets, scratch, node)
    return node


@njit(cache=True)
def common_ancestor(state, a, b):  # type: ignore[no-untyped-def]
    """The lowest node above both; `NONE` if they belong to different fragments."""
    node = a
    while node != NONE:
        other = b
        while other != NONE:
            if other == node:
                return node
            other = state.parent[other]
        node = state.parent[node]
    return NONE


@njit(cache=True)
def recut(state, targets, scratch, a, b):  # type: ignore[no-untyped-def]
    """Cut to volumes below the common ancestor of two nodes, or below both roots."""
    add_up_wanted(state, targets.volumes)
    node = common_ancestor(state, a, b)
    if node != NONE:
        cut_to_volumes(state, targets, scratch, node)
    else:
        cut_to_volumes(state, targets, scratch, state.root[a])
        cut_to_volumes(state, targets, scratch, state.root[b])


@njit(cache=True)
def swap_goals(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Exchange the goal fragments of two leaves, with the planes as they are or shifted to the volumes."""
    a = leaf_node(state, rng)
    b = partner(state, a, rng, True)
    if b == NONE:
        return NONE
    state.goal[a], state.goal[b] = state.goal[b], state.goal[a]
    state.key[a] = state.key[b] = UNSCORED
    if uniform(rng) < 0.5:
        add_up_wanted(state, targets.volumes)
        cut_below(state, targets, scratch, a)
        cut_below(state, targets, scratch, b)
    else:
        recut(state, targets, scratch, a, b)
    return len(state.left)


@njit(cache=True)
def replace_child(state, parent, old, new):  # type: ignore[no-untyped-def]
    """Put `new` in the place of the child `old` of `parent`."""
    if state.left[parent] == old:
        state.left[parent] = new
    else:
        state.right[parent] = new
    state.parent[new] = parent


@njit(cache=True)
def set_root(state, top, root):  # type: ignore[no-untyped-def]
    """Note for all nodes below `top` that they belong to the fragment `root`."""
    stack = np.empty(len(state.left), np.int64)
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        state.root[node] = root
        state.key[node] = UNSCORED
        if state.left[node] != NONE:
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2


@njit(cache=True)
def swap_subtrees(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Exchange two subtrees, neither of which contains the other."""
    a = below(rng, len(state.left))
    b = partner(state, a, rng, False)
    if b == NONE or state.parent[a] == NONE or state.parent[b] == NONE or state.parent[a] == state.parent[b]:
        return NONE
    common = common_ancestor(state, a, b)
    if common in (a, b):
        return NONE
    parent_a, parent_b = state.parent[a], state.parent[b]
    replace_child(state, parent_a, a, b)
    replace_child(state, parent_b, b, a)
    root_a, root_b = state.root[a], state.root[b]
    if root_a != root_b:
        set_root(state, a, root_b)
        set_root(state, b, root_a)
    recut(state, targets, scratch, parent_a, parent_b)
    return len(state.left)


@njit(cache=True)
def mirror(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Exchange the sides of one plane, and with a probability of one half of all planes below."""
    top = inner_node(state, rng)
    if top == NONE:
        return NONE
    deep = uniform(rng) < 0.5
    stack = scratch.stack
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] == NONE:
            continue
        state.left[node], state.right[node] = state.right[node], state.left[node]
        if deep:
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2
    cut_to_volumes(state, targets, scratch, top)
    return top


@njit(cache=True)
def rotate(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Make a child's plane the one that is cut first: a rotation of the tree, for planes that do not cross."""
    node = inner_node(state, rng)
    if node == NONE:
        return NONE
    from_left = uniform(rng) < 0.5
    child = state.left[node] if from_left else state.right[node]
    if state.left[child] == NONE:
        return NONE
    # The nodes keep their places in the tree, so that a root stays a root; their planes are exchanged.
    x, y = state.left[child], state.right[child]
    other = state.right[node] if from_left else state.left[node]
    same = 0.0
    for axis in range(3):
        same += state.planes[node, axis] * state.planes[child, axis]
    for axis in range(4):
        state.planes[node, axis], state.planes[child, axis] = state.planes[child, axis], state.planes[node, axis]
    if from_left:
        # ((x y) other) -> (x (y other)), or (y (x other)) where the planes face each other
        if same >= 0.0:
            state.left[node], state.right[node] = x, child
            state.left[child], state.right[child] = y, other
        else:
            state.left[node], state.right[node] = child, y
            state.left[child], state.right[child] = x, other
    else:
        if same >= 0.0:
            state.left[node], state.right[node] = child, y
            state.left[child], state.right[child] = other, x
        else:
            state.left[node], state.right[node] = x, child
            state.left[child], state.right[child] = other, y
    for parent in (node, child):
        state.parent[state.left[parent]] = parent
        state.parent[state.right[parent]] = parent
    add_up_wanted(state, targets.volumes)
    cut_to_volumes(state, targets, scratch, node)
    return node


@njit(cache=True)
def transplant(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Take a subtree out and cut it off another node, along an axis or parallel to another plane."""
    n = len(state.left)
    moved = below(rng, n) if uniform(rng) < 0.3 else leaf_node(state, rng)
    joint = state.parent[moved]
    if joint == NONE:
        return NONE
    sibling = state.left[joint] if state.right[joint] == moved else state.right[joint]
    place = below(rng, n)
    if place in (joint, sibling) or common_ancestor(state, moved, place) == moved:
        return NONE
    above = state.parent[joint]
    old_root, new_root = state.root[joint], state.root[place]
    if above == NONE:
        # A root keeps its index: the sibling's content moves into it, and the sibling's index becomes the joint.
        if state.left[sibling] == NONE and new_root == old_root:
            return NONE
        if place == sibling:
            return NONE
        _move_up(state, sibling, joint)
        if place == joint:
            return NONE
        joint, sibling = sibling, joint
        above = NONE
    else:
        replace_child(state, above, joint, sibling)
        state.first[sibling], state.last[sibling] = state.first[joint], state.last[joint]
    state.goal[joint] = NONE
    # Now `joint` is free and becomes the parent of `moved` and of what was at `place`.
    parent = state.parent[place]
    if parent == NONE:
        _move_down(state, place, joint)
        joint, place = place, joint
    else:
        replace_child(state, parent, place, joint)
    if uniform(rng) < 0.5:
        state.left[joint], state.right[joint] = moved, place
    else:
        state.left[joint], state.right[joint] = place, moved
    state.parent[moved] = state.parent[place] = joint
    state.root[joint] = new_root
    if old_root != new_root:
        set_root(state, moved, new_root)
    # The new plane's normal comes from the points as they were divided before.
    state.first[joint], state.last[joint] = state.first[place], state.last[place]
    draw_normal(state, joint, rng)
    recut(state, targets, scratch, sibling, joint)
    return len(state.left)


@njit(cache=True)
def _move_up(state, child, root):  # type: ignore[no-untyped-def]
    """Let the node `root` take over plane, children and goal of its child."""
    state.left[root], state.right[root], state.goal[root] = state.left[child], state.right[child], state.goal[child]
    state.key[root] = UNSCORED
    for axis in range(4):
        state.planes[root, axis] = state.planes[child, axis]
    if state.left[root] != NONE:
        state.parent[state.left[root]] = root
        state.parent[state.right[root]] = root


@njit(cache=True)
def _move_down(state, root, free):  # type: ignore[no-untyped-def]
    """Let the unused node `free` take over plane, children, goal and points of a root."""
    state.left[free], state.right[free], state.goal[free] = state.left[root], state.right[root], state.goal[root]
    state.first[free], state.last[free] = state.first[root], state.last[root]
    state.root[free] = root
    state.key[free] = UNSCORED
    state.goal[root] = NONE
    for axis in range(4):
        state.planes[free, axis] = state.planes[root, axis]
    if state.left[free] != NONE:
        state.parent[state.left[free]] = free
        state.parent[state.right[free]] = free


@njit(cache=True)
def regrow(state, targets, scratch, rng):  # type: ignore[no-untyped-def]
    """Give all planes of a small subtree new normals, and shuffle its goal fragments."""
    top = inner_node(state, rng)
    if top == NONE:
        return NONE
    leaves = np.empty(len(state.left), np.int64)
    stack = np.empty(len(state.left), np.int64)
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
    if m > 8:
        return NONE
    if uniform(rng) < 0.7:
        for i in range(m - 1, 0, -1):
            j = below(rng, i + 1)
            a, b = leaves[i], leaves[j]
            state.goal[a], state.goal[b] = state.goal[b], state.goal[a]
        for i in range(m):
            state.key[leaves[i]] = UNSCORED
        add_up_wanted(state, targets.volumes)
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] != NONE:
            draw_normal(state, node, rng)
            shift_to_volumes(state, scratch, node)
            cut_below(state, targets, scratch, node)
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2
    return top
