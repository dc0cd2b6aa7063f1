"""A plan that is fitted at one resolution: annealing in chunks, with groundings between them, within a budget."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.fitting.annealing import anneal, copy_plan
from cutgrammar.fitting.plan_state import (
    NONE,
    UNSCORED,
    PlanState,
    Scratch,
    add_up_wanted,
    duplicate,
    iou_table,
    scratch_for,
    total_iou,
)
from cutgrammar.fitting.plan_tree import PlanTree, state_of, trees_of
from cutgrammar.fitting.recut import recut
from cutgrammar.fitting.targets import Targets
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.arrays import Floats
from cutgrammar.inference.draws import State

KINDS = 9
"""Kinds of moves."""
MIX = np.cumsum([0.12, 0.28, 0.15, 0.05, 0.1, 0.15, 0.08])
"""Cumulative shares of the moves that restructure: align, swap goals, swap subtrees, mirror, rotate, transplant, and
transpose."""
NO_DRAWS = np.zeros(1, np.uint64)
COMPARED = 160
"""Sample points of a terminal that are compared with its target while exploring."""
SMALL = 0.2
"""The terminals that set the resolution: the quantile of the goal's volumes."""
ENOUGH = 12
"""Smallest number of terminals that a plan is given points for: what is cut into few is looked at more closely."""
FEWEST = 200
"""Smallest number of points of a current fragment."""
CHUNK = 2000
"""Evaluations between two groundings by the Hungarian algorithm, and between two looks at the clock."""


@dataclass
class Budget:
    """What a fitting may spend.

    Attributes:
        evaluations: number of evaluations.
        deadline: time by `time.monotonic` [s]; None: no limit. With one, results are not reproducible.
        spent: evaluations made so far.
    """

    evaluations: int
    deadline: float | None = None
    spent: int = 0

    @property
    def exhausted(self) -> bool:
        """Whether the time is up or no evaluations are left."""
        return self.spent >= self.evaluations or (self.deadline is not None and time.monotonic() >= self.deadline)


@dataclass
class PlanFit:
    """A plan that is being fitted at one resolution, with the best version of it so far."""

    state: PlanState
    targets: Targets
    compared: int
    scratch: Scratch = field(init=False)
    backup: PlanState = field(init=False)
    best: PlanState = field(init=False)

    def __post_init__(self) -> None:
        self.scratch = scratch_for(self.state, self.compared)
        for root in range(len(self.state.weight)):
            self._recut(root)
        self.backup, self.best = duplicate(self.state), duplicate(self.state)

    @staticmethod
    def of(
        trees: Sequence[PlanTree],
        pieces: Sequence[Workpiece],
        targets: Targets,
        n_points: int,
        compared: int = COMPARED,
    ) -> "PlanFit":
        """A plan at a resolution of so many points in all, of which so many of each terminal are compared."""
        compared = compared * ENOUGH // min(ENOUGH, len(targets.volumes))
        volumes = np.array([piece.volume for piece in pieces])
        counts = np.maximum(n_points * volumes / volumes.sum(), FEWEST).astype(np.int64).tolist()
        points = [piece.points[:count] for piece, count in zip(pieces, counts, strict=True)]
        return PlanFit(state_of(list(trees), points, volumes, targets), targets, compared)

    @property
    def iou(self) -> float:
        """Predicted strict IoU of the best plan so far."""
        return float(total_iou(self.best)) / len(self.targets.volumes)

    def ground(self) -> None:
        """Ground the terminals of the state anew, where that is better."""
        state = self.state
        leaves = np.flatnonzero(state.goal != NONE)
        table = iou_table(state, self.targets, self.scratch)
        rows, columns = linear_sum_assignment(table, maximize=True)
        if table[rows, columns].sum() <= state.iou[leaves].sum() + 1e-9:
            return
        state.goal[leaves[rows]] = columns
        state.key[leaves] = UNSCORED
        for leaf in leaves:
            self._recut(int(leaf))
        add_up_wanted(state, self.targets.volumes)
        if total_iou(state) > total_iou(self.best):
            copy_plan(state, self.best)

    def _recut(self, top: int) -> None:
        self.scratch.tops[0] = top
        recut(self.state, self.targets, self.scratch, 1, -1.0, NO_DRAWS)

    def run(
        self, evaluations: int, temperatures: tuple[float, float], restructuring: float, rng: State, budget: Budget
    ) -> list[tuple[int, float]]:
        """Anneal by so many evaluations, or fewer if the budget ends; return the history."""
        hot, cold = temperatures
        done, history = 0, []
        counts = np.zeros((KINDS, 2), np.int64)
        evaluations = min(evaluations, budget.evaluations - budget.spent)
        while done < evaluations and not budget.exhausted:
            n = min(CHUNK, evaluations - done)
            a, b = (hot * (cold / hot) ** (at / evaluations) for at in (done, done + n))
            anneal(
                self.state, self.backup, self.best, self.targets, self.scratch, rng, n, a, b, restructuring, MIX, counts
            )
            self.ground()
            done += n
            budget.spent += n
            history.append((budget.spent, self.iou))
        return history

    @property
    def ends(self) -> tuple[tuple[PlanTree, ...], tuple[PlanTree, ...]]:
        """The best plan so far, and the plan as it is."""
        return tuple(trees_of(self.best)), tuple(trees_of(self.state))

    @property
    def leaf_ious(self) -> Floats:
        """(g,) predicted IoU of every goal fragment in the best plan so far."""
        leaves = np.flatnonzero(self.best.goal != NONE)
        ious = np.zeros(len(self.targets.volumes))
        ious[self.best.goal[leaves]] = self.best.iou[leaves]
        return ious


def resolution(targets: Targets, points: int, most: int) -> int:
    """Number of points of a whole plan with which a small terminal has so many.

    Args:
        targets: of the goal.
        points: wanted in a terminal of the volume that a share `SMALL` of the goal's fragments does not exceed.
        most: largest number of points of a plan.
    """
    small = float(np.quantile(targets.volumes, SMALL))
    return min(max(int(points * float(targets.volumes.sum()) / small), ENOUGH * points), most)
