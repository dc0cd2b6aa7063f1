"""Carrying a plan over to the fragments that are there after a cut: what was planned for the products still holds.

What a plan expects (fragments that were not cut, and the two sides of the plane) is assigned to the fragments that are
there, by volume, extents and place. If a fragment moved, its planes move with it, by the canonical alignment that
predicts the best result. If there are more fragments than expected (a plane can divide a bent object into three), the
terminals that fit worst are given to the surplus; if there are fewer, their terminals are joined to the largest one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.fitting.plan_fit import PlanFit
from cutgrammar.fitting.plan_tree import Branch, Leaf, PlanTree, goals_of
from cutgrammar.fitting.targets import Targets
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose

MATCHING_POINTS = 2000
"""Sample points with which alignments are compared."""
STILL = 0.02
"""A fragment whose centroid is this near to where it was expected did not move, in units of its size."""


@dataclass(frozen=True, eq=False)
class Expected:
    """A fragment that a plan expects.

    Attributes:
        tree: what is planned for it, with planes in frame C.
        X_WC: pose of C in the world frame.
        points: (n, 3) points inside it, in C [m].
        volume: [m3].
    """

    tree: PlanTree
    X_WC: Pose
    points: Floats
    volume: float

    @property
    def p_WC(self) -> Floats:
        """(3,) centroid in the world frame [m]."""
        return self.X_WC.apply(self.points.mean(axis=0))

    @property
    def deviations(self) -> Floats:
        """(3,) standard deviations along the principal axes, ascending [m]."""
        return np.asarray(np.sqrt(np.linalg.eigvalsh(np.cov(self.points.T)).clip(0.0)))


def expected_after(trees: Sequence[PlanTree], pieces: Sequence[Workpiece], cut: int | None) -> list[Expected]:
    """What is expected after the first plane of tree `cut` was cut; None: nothing was."""
    found = []
    for i, (tree, piece) in enumerate(zip(trees, pieces, strict=True)):
        if i != cut or isinstance(tree, Leaf):
            found.append(Expected(tree, piece.X_WC, piece.points, piece.volume))
            continue
        assert tree.normal is not None
        assert tree.offset is not None
        above = piece.points @ tree.normal + tree.offset >= 0.0
        for side, subtree in ((~above, tree.below), (above, tree.above)):
            if side.sum() > 3:
                found.append(Expected(subtree, piece.X_WC, piece.points[side], piece.volume * float(side.mean())))
            else:  # nothing is cut off there
                found.append(Expected(subtree, piece.X_WC, piece.points[:4], 0.0))
    return found


def carry_over(expected: Sequence[Expected], pieces: Sequence[Workpiece], targets: Targets) -> tuple[PlanTree, ...]:
    """The trees of the fragments that are there now.

    Args:
        expected: from the previous plan.
        pieces: the current fragments, at most as many as the goal has.
        targets: of the goal.
    """
    rows, columns = linear_sum_assignment(_costs(expected, pieces))
    trees: list[PlanTree | None] = [None] * len(pieces)
    for i, k in zip(rows.tolist(), columns.tolist(), strict=True):
        trees[k] = aligned(expected[i], pieces[k], targets)
    for i in sorted(set(range(len(expected))) - set(rows.tolist())):
        largest = max((k for k, tree in enumerate(trees) if tree), key=lambda k: pieces[k].volume)
        joined = trees[largest]
        assert joined is not None
        trees[largest] = Branch(joined, _without_planes(expected[i].tree))
    for k in [k for k, tree in enumerate(trees) if tree is None]:
        planned = [(j, tree) for j, tree in enumerate(trees) if tree is not None]
        fit = PlanFit.of([tree for _, tree in planned], [pieces[j] for j, _ in planned], targets, MATCHING_POINTS)
        candidates = [
            (float(fit.leaf_ious[goal]), goal, j)
            for j, tree in planned
            if isinstance(tree, Branch)
            for goal in goals_of(tree)
        ]
        _, goal, j = min(candidates)
        tree = trees[j]
        assert tree is not None
        trees[j], trees[k] = pruned(tree, goal), Leaf(goal)
    return tuple(tree for tree in trees if tree is not None)


def aligned(expected: Expected, piece: Workpiece, targets: Targets) -> PlanTree:
    """The expected tree with its planes in the canonical frame of the fragment that is there."""
    if isinstance(expected.tree, Leaf):
        return expected.tree
    size = piece.volume ** (1.0 / 3.0)
    in_place = moved(expected.tree, piece.X_WC.inverse() @ expected.X_WC)
    if float(np.linalg.norm(expected.p_WC - piece.X_WC.position)) < STILL * size:
        return in_place
    _, axes = np.linalg.eigh(np.cov(expected.points.T))
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    X_CE = Pose(axes, expected.points.mean(axis=0))
    options = [in_place, *(moved(expected.tree, flip @ X_CE.inverse()) for flip in FLIPS)]
    ious = [PlanFit.of([tree], [piece], targets, MATCHING_POINTS).iou for tree in options]
    return options[int(np.argmax(ious))]


def moved(tree: PlanTree, X_BA: Pose) -> PlanTree:
    """The tree with its planes, given in frame A, expressed in frame B."""
    if isinstance(tree, Leaf):
        return tree
    below, above = moved(tree.below, X_BA), moved(tree.above, X_BA)
    if tree.normal is None or tree.offset is None:
        return Branch(below, above)
    plane_B = Plane(tree.normal, tree.offset).transformed(X_BA)
    return Branch(below, above, plane_B.normal, plane_B.offset)


def pruned(tree: PlanTree, goal: int) -> PlanTree:
    """The tree without the leaf of this goal fragment, whose sibling takes its parent's place."""
    if isinstance(tree, Leaf):
        return tree
    for child, other in ((tree.below, tree.above), (tree.above, tree.below)):
        if isinstance(child, Leaf) and child.goal == goal:
            return other
    return Branch(pruned(tree.below, goal), pruned(tree.above, goal), tree.normal, tree.offset)


def _without_planes(tree: PlanTree) -> PlanTree:
    return tree if isinstance(tree, Leaf) else Branch(_without_planes(tree.below), _without_planes(tree.above))


def _costs(expected: Sequence[Expected], pieces: Sequence[Workpiece]) -> Floats:
    """(e, k) how unlike each expected fragment is to each that is there: in volume, extents and place."""
    costs = np.zeros((len(expected), len(pieces)))
    there = [np.sqrt(np.linalg.eigvalsh(np.cov(piece.points.T)).clip(0.0)) for piece in pieces]
    for i, one in enumerate(expected):
        deviations, p_WC = one.deviations, one.p_WC
        for k, piece in enumerate(pieces):
            size = piece.volume ** (1.0 / 3.0)
            costs[i, k] = abs(np.log(max(one.volume, 1e-12) / piece.volume))
            costs[i, k] += float(np.abs(np.log(deviations.clip(1e-6) / there[k].clip(1e-6))).sum())
            costs[i, k] += 0.2 * min(float(np.linalg.norm(p_WC - piece.X_WC.position)) / size, 5.0)
    return costs
