"""Renewal: the part of a plan that fits worst is annealed again by itself, and put back if it became better.

A part is the subtree of one node, or all that is planned for two current fragments. It is a fitting problem of its own,
whose current fragments are the sample points of its nodes and whose goal is what is grounded there. Small parts are
annealed in a fraction of the time of the whole plan, and what fits already is not put at risk.
"""

from collections.abc import Sequence

import numpy as np

from cutgrammar.fitting.plan_fit import Budget, PlanFit
from cutgrammar.fitting.plan_tree import Branch, Leaf, PlanTree, goals_of, state_of
from cutgrammar.fitting.targets import Targets
from cutgrammar.geometry.arrays import Floats
from cutgrammar.inference.draws import draws_from

PER_LEAF = 1500
"""Evaluations of a renewal for each leaf of the part."""
RESTRUCTURING = 0.8
"""Share of them that change structure and grounding."""
PAIRED = 0.3
"""Share of the renewals, where there are several current fragments, of all that is planned for two of them."""
SPARED = 0.04
"""Lack of IoU of a leaf that cannot be hoped to vanish."""

Path = tuple[bool, ...]
"""A node of a tree: for each step down from the root, whether it is to the side above."""


def renewed(plan: PlanFit, hot: float, cold: float, budget: Budget, rng: np.random.Generator) -> tuple[PlanTree, ...]:
    """A plan whose worst parts were renewed until the budget was spent.

    Args:
        plan: at the resolution of the renewals.
        hot, cold: first and last temperature of a renewal [sum of IoU].
        budget: of all renewals.
        rng: random stream.
    """
    draws = draws_from(rng)
    trees = list(plan.ends[0])
    best = plan.best
    points = [best.points[best.first[root] : best.last[root]].astype(np.float64) for root in range(len(trees))]
    lacks = np.maximum(1.0 - plan.leaf_ious - SPARED, 1e-3)
    while not budget.exhausted:
        parts = _drawn(trees, lacks, rng)
        goals = [goal for root, path in parts for goal in goals_of(_at(trees[root], path))]
        targets = Targets._make(array[goals] for array in plan.targets)
        number = {goal: i for i, goal in enumerate(goals)}
        subtrees = [_renumbered(_at(trees[root], path), number) for root, path in parts]
        inside = [_inside(trees[root], path, points[root]) for root, path in parts]
        volumes = np.array(
            [len(each) * float(best.weight[root]) for each, (root, _) in zip(inside, parts, strict=True)]
        )
        part = PlanFit(state_of(subtrees, inside, volumes, targets), targets, plan.compared)
        before = part.iou
        part.run(PER_LEAF * len(goals), (hot, cold), RESTRUCTURING, draws, budget)
        if part.iou > before:
            back = dict(enumerate(goals))
            for (root, path), tree in zip(parts, part.ends[0], strict=True):
                trees[root] = _replaced(trees[root], path, _renumbered(tree, back))
            lacks[goals] = np.maximum(1.0 - part.leaf_ious - SPARED, 1e-3)
    return tuple(trees)


def _drawn(trees: Sequence[PlanTree], lacks: Floats, rng: np.random.Generator) -> list[tuple[int, Path]]:
    """Draw a part: around a leaf, the more readily the worse it fits, of a size spread evenly in the logarithm."""
    goal = int(rng.choice(len(lacks), p=lacks / lacks.sum()))
    root = next(i for i, tree in enumerate(trees) if goal in goals_of(tree))
    if len(trees) > 1 and rng.random() < PAIRED:
        other = int(rng.choice([i for i in range(len(trees)) if i != root]))
        if isinstance(trees[root], Branch) or isinstance(trees[other], Branch):
            return [(min(root, other), ()), (max(root, other), ())]
    size = np.exp(rng.uniform(np.log(3.0), np.log(max(len(lacks), 4.0))))
    path: Path = ()
    node = trees[root]
    while len(goals_of(node)) > size and isinstance(node, Branch):
        above = goal in goals_of(node.above)
        following = node.above if above else node.below
        if isinstance(following, Leaf):
            break
        path, node = (*path, above), following
    return [(root, path)]


def _at(tree: PlanTree, path: Path) -> PlanTree:
    for above in path:
        assert isinstance(tree, Branch)
        tree = tree.above if above else tree.below
    return tree


def _replaced(tree: PlanTree, path: Path, new: PlanTree) -> PlanTree:
    if not path:
        return new
    assert isinstance(tree, Branch)
    below, above = tree.below, tree.above
    if path[0]:
        above = _replaced(above, path[1:], new)
    else:
        below = _replaced(below, path[1:], new)
    return Branch(below, above, tree.normal, tree.offset)


def _inside(tree: PlanTree, path: Path, points: Floats) -> Floats:
    """The points (n, 3) that belong to a node."""
    for step in path:
        assert isinstance(tree, Branch)
        assert tree.normal is not None
        assert tree.offset is not None
        points = points[(points @ tree.normal + tree.offset >= 0.0) == step]
        tree = tree.above if step else tree.below
    return points


def _renumbered(tree: PlanTree, number: dict[int, int]) -> PlanTree:
    if isinstance(tree, Leaf):
        return Leaf(number[tree.goal])
    below, above = _renumbered(tree.below, number), _renumbered(tree.above, number)
    return Branch(below, above, tree.normal, tree.offset)
