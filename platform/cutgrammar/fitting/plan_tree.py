"""Plans as trees of values: what sources of starting plans hand to the fitting, and what it returns."""

from dataclasses import dataclass

import numpy as np

from cutgrammar.fitting.plan_state import (
    NONE,
    UNSCORED,
    PlanState,
    add_up_wanted,
    partition,
    scratch_for,
    shift_to_volumes,
)
from cutgrammar.fitting.principal_frame import moments, principal_axes
from cutgrammar.fitting.targets import Targets
from cutgrammar.geometry.arrays import Floats


@dataclass(frozen=True)
class Leaf:
    """A terminal: the goal's fragment that it shall become."""

    goal: int


@dataclass(frozen=True, eq=False)
class Branch:
    """A cut and the subtrees of its products.

    Attributes:
        below, above: subtrees on the two sides of the plane.
        normal: (3,) of the plane, in the canonical frame C of the current fragment; None: the longest principal axis.
        offset: of the plane [m]; None: by the volumes of the goal's fragments on both sides.
    """

    below: "PlanTree"
    above: "PlanTree"
    normal: Floats | None = None
    offset: float | None = None


PlanTree = Leaf | Branch
"""The plan of one current fragment."""


def goals_of(tree: PlanTree) -> list[int]:
    """The goal's fragments at the leaves, from left to right."""
    if isinstance(tree, Leaf):
        return [tree.goal]
    return goals_of(tree.below) + goals_of(tree.above)


def state_of(trees: list[PlanTree], points: list[Floats], volumes: Floats, targets: Targets) -> PlanState:
    """The arrays of a plan, cut virtually but with no leaf scored.

    Args:
        trees: the plan of each current fragment.
        points: (n, 3) sample points of each, in its canonical frame C [m].
        volumes: (m,) of the current fragments [m3].
        targets: of the goal.
    """
    n = sum(2 * len(goals_of(tree)) - 1 for tree in trees)
    counts = np.array([len(each) for each in points])
    ends = np.cumsum(counts)
    state = PlanState(
        left=np.full(n, NONE),
        right=np.full(n, NONE),
        parent=np.full(n, NONE),
        root=np.zeros(n, np.int64),
        goal=np.full(n, NONE),
        planes=np.zeros((n, 4)),
        wanted=np.zeros(n),
        first=np.zeros(n, np.int64),
        last=np.zeros(n, np.int64),
        key=np.full(n, UNSCORED),
        iou=np.zeros(n),
        points=np.asfortranarray(np.concatenate(points), np.float32),
        keys=np.random.default_rng(0).integers(0, 2**32, size=int(ends[-1]), dtype=np.uint32),
        weight=volumes / counts,
    )
    state.first[: len(trees)], state.last[: len(trees)] = ends - counts, ends
    free = len(trees)
    pending: list[tuple[int, PlanTree]] = []
    for root, tree in enumerate(trees):
        stack = [(root, tree)]
        while stack:
            node, subtree = stack.pop()
            state.root[node] = root
            if isinstance(subtree, Leaf):
                state.goal[node] = subtree.goal
                continue
            pending.append((node, subtree))
            state.left[node], state.right[node] = free, free + 1
            state.parent[[free, free + 1]] = node
            stack += [(free + 1, subtree.above), (free, subtree.below)]
            free += 2
    add_up_wanted(state, targets.volumes)
    scratch = scratch_for(state, 0)
    for node, branch in pending:
        assert isinstance(branch, Branch)
        state.planes[node, :3] = _longest_axis(state, node) if branch.normal is None else branch.normal
        if branch.offset is None:
            shift_to_volumes(state, scratch, node)
        else:
            state.planes[node, 3] = branch.offset
        partition(state, scratch, node)
    return state


def _longest_axis(state: PlanState, node: int) -> Floats:
    first, last = int(state.first[node]), int(state.last[node])
    if last - first < 4:
        return np.array([0.0, 0.0, 1.0])
    centre, covariance, axes = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    moments(state.points, first, last, centre, covariance)
    principal_axes(covariance, axes)
    return axes[:, 2]


def trees_of(state: PlanState) -> list[PlanTree]:
    """The inverse of `state_of`: every branch with its plane."""

    def tree(node: int) -> PlanTree:
        if state.left[node] == NONE:
            return Leaf(int(state.goal[node]))
        left, right = int(state.left[node]), int(state.right[node])
        return Branch(tree(left), tree(right), state.planes[node, :3].copy(), float(state.planes[node, 3]))

    return [tree(root) for root in range(len(state.weight))]
