"""Starting plans for the fitting: the interface of their sources, and the two sources that learn nothing."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from cutgrammar.fitting.plan_fit import PlanFit
from cutgrammar.fitting.plan_tree import Branch, Leaf, PlanTree
from cutgrammar.fitting.targets import Targets
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration


class StartingPlans(Protocol):
    """A source of starting plans."""

    def __call__(
        self,
        now: Configuration,
        goal: Configuration,
        pieces: Sequence[Workpiece],
        targets: Targets,
        n: int,
        rng: np.random.Generator,
    ) -> list[tuple[PlanTree, ...]]:
        """At least one plan, at most n: each a tree for every current fragment.

        Args:
            now, goal: the configurations.
            pieces, targets: the same, prepared for virtual cutting.
            n: number of plans wanted.
            rng: random stream.
        """
        ...


def halving_plans(
    now: Configuration,
    goal: Configuration,
    pieces: Sequence[Workpiece],
    targets: Targets,
    n: int,
    rng: np.random.Generator,
) -> list[tuple[PlanTree, ...]]:
    """Plans that divide a random order of the goal's fragments by recursive halving, across the longest axes."""
    del now, goal
    volumes = np.array([piece.volume for piece in pieces])
    return [tuple(halved(goals) for goals in shared_out(volumes, targets.volumes, rng)) for _ in range(n)]


def halved(goals: Sequence[int]) -> PlanTree:
    """A balanced tree of cuts across the longest axes, with these goal fragments from left to right."""
    if len(goals) == 1:
        return Leaf(goals[0])
    middle = len(goals) // 2
    return Branch(halved(goals[:middle]), halved(goals[middle:]))


def shared_out(volumes: Floats, wanted: Floats, rng: np.random.Generator) -> list[list[int]]:
    """Share out goal fragments in random order, each to the current fragment with the most volume left.

    Args:
        volumes: (m,) of the current fragments [m3].
        wanted: (g,) of the goal's, g >= m [m3].
        rng: random stream.

    Returns:
        The goal fragments of every current fragment, at least one each.
    """
    left = volumes.copy()
    shares: list[list[int]] = [[] for _ in volumes]
    for dealt, goal in enumerate(rng.permutation(len(wanted)).tolist()):
        empty = [i for i, share in enumerate(shares) if not share]
        chosen = empty[0] if len(wanted) - dealt <= len(empty) else int(np.argmax(left))
        shares[chosen].append(goal)
        left[chosen] -= wanted[goal]
    return shares


def peeling_plans(
    now: Configuration,
    goal: Configuration,
    pieces: Sequence[Workpiece],
    targets: Targets,
    n: int,
    rng: np.random.Generator,
) -> list[tuple[PlanTree, ...]]:
    """Plans that peel one goal fragment after another off the ends, across the axis where it fits best."""
    del now, goal
    volumes = np.array([piece.volume for piece in pieces])
    return [
        tuple(
            peeled(piece, goals, targets)
            for piece, goals in zip(pieces, shared_out(volumes, targets.volumes, rng), strict=True)
        )
        for _ in range(n)
    ]


PEELING_POINTS = 1000
"""Sample points with which peeling compares axes."""


def peeled(piece: Workpiece, goals: Sequence[int], targets: Targets) -> PlanTree:
    """A tree that peels the goal fragments in this order, each across the axis and from the end where it fits best."""
    planes: list[tuple[int, Floats, bool]] = []

    def tree(last: list[tuple[int, Floats, bool]], rest: Sequence[int]) -> PlanTree:
        inner: PlanTree = halved(rest)
        for goal, normal, below in reversed(last):
            inner = Branch(Leaf(goal), inner, normal) if below else Branch(inner, Leaf(goal), normal)
        return inner

    for i, goal in enumerate(goals[:-1]):
        best: tuple[float, tuple[int, Floats, bool]] | None = None
        for axis in range(3):
            for below in (True, False):
                peel = goal, np.eye(3)[axis], below
                trial = PlanFit.of([tree([*planes, peel], goals[i + 1 :])], [piece], targets, PEELING_POINTS)
                iou = float(trial.leaf_ious[goal])
                if best is None or iou > best[0]:
                    best = iou, peel
        assert best is not None
        planes.append(best[1])
    return tree(planes, goals[-1:])
