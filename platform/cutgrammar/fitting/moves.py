"""Changes of a plan that fitting tries: of planes, of the grounding of terminals, and of the structure.

A move edits planes and tree of a `PlanState`, notes in `Scratch` below which nodes must be cut again and which planes
must be shifted or drawn anew, and returns the number of these nodes, 0 if it does not apply. Moves of structure and
grounding shift the planes below to the volumes then wanted, because with planes that stay no exchange of unequal
fragments could ever pay.
"""

import numpy as np
from numba import njit

from cutgrammar.fitting.plan_state import DRAW, NONE, SHIFT, UNSCORED, add_up_wanted
from cutgrammar.inference.draws import below, uniform

TURN, STEP = 0.6, 0.5
"""Largest scale of a turn [rad] and of a shift, in standard deviations of the points along the normal."""
SIMILAR = 0.15
"""Nodes whose wanted volumes differ by this log ratio are exchanged half as often as those of equal volumes."""
ALSO_GOOD = 0.1
"""Share of leaves with an IoU of 1 that are taken when a leaf that fits badly is wanted."""
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
def inner_node(state, rng):  # type: ignore[no-untyped-def]
    """Draw an inner node; `NONE` if none is found."""
    for _ in range(30):
        node = below(rng, len(state.left))
        if state.left[node] != NONE:
            return node
    return NONE


@njit(cache=True)
def leaf_node(state, rng):  # type: ignore[no-untyped-def]
    """Draw a leaf."""
    while True:
        node = below(rng, len(state.left))
        if state.goal[node] != NONE:
            return node


@njit(cache=True)
def poor_leaf(state, rng):  # type: ignore[no-untyped-def]
    """Draw a leaf, the more readily the worse it fits."""
    leaf = leaf_node(state, rng)
    for _ in range(20):
        if uniform(rng) < 1.0 + ALSO_GOOD - state.iou[leaf]:
            break
        leaf = leaf_node(state, rng)
    return leaf


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
def mark_below(state, scratch, top, redo):  # type: ignore[no-untyped-def]
    """Note for every inner node at or below `top` what happens to its plane."""
    stack = scratch.stack
    stack[0], n = top, 1
    while n > 0:
        n -= 1
        node = stack[n]
        if state.left[node] != NONE:
            scratch.redo[node] = redo
            stack[n], stack[n + 1] = state.left[node], state.right[node]
            n += 2


@njit(cache=True)
def cut_at(scratch, node):  # type: ignore[no-untyped-def]
    """Ask for cutting again below one node."""
    scratch.tops[0] = node
    return 1


@njit(cache=True)
def shift_all(state, targets, scratch, a, b):  # type: ignore[no-untyped-def]
    """Ask for shifting all planes below the common ancestor of two nodes, or below both roots."""
    add_up_wanted(state, targets.volumes)
    node = common_ancestor(state, a, b)
    if node != NONE:
        mark_below(state, scratch, node, SHIFT)
        return cut_at(scratch, node)
    for i, root in enumerate((state.root[a], state.root[b])):
        mark_below(state, scratch, root, SHIFT)
        scratch.tops[i] = root
    return 2


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
    stack = scratch.stack
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
        _move_up(state, sibling, joint)
        joint, sibling = sibling, joint
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
    """Let the unused node `free` take over plane, children and goal of a root."""
    state.left[free], state.right[free], state.goal[free] = state.left[root], state.right[root], state.goal[root]
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
