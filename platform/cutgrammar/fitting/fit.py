"""Fitting whole plans to a goal: several starts at a coarse resolution, then the best plan at a fine one.

The score of a plan is the strict IoU that virtual cutting predicts: the mean over its terminals of the IoU with the
goal's fragments that they are grounded in, as the score of a trial computes it from meshes. One evaluation is one
change tried: the plan is cut virtually where the change reaches, and scored. Between the chunks of an annealing the
Hungarian algorithm grounds the terminals anew. The best plan by the fine score is kept, and a start counts too, so that
a fitted plan is never worse than its start.
"""

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
    iou_table,
    scratch_for,
    total_iou,
)
from cutgrammar.fitting.plan_tree import PlanTree, state_of, trees_of
from cutgrammar.fitting.recut import recut
from cutgrammar.fitting.targets import Targets
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.arrays import Floats
from cutgrammar.inference.draws import State, draws_from
from cutgrammar.settings import FittingLevel, FittingSettings

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
FEWEST = 200
"""Smallest number of points of a current fragment."""
CHUNK = 2000
"""Evaluations between two groundings by the Hungarian algorithm, and between two looks at the clock."""


@dataclass(frozen=True, eq=False)
class FittedPlan:
    """A fitted plan.

    Attributes:
        trees: one for each current fragment.
        iou: predicted strict IoU.
        leaf_ious: predicted IoU of every goal fragment.
        history: (evaluations made, best predicted strict IoU so far), ascending.
    """

    trees: tuple[PlanTree, ...]
    iou: float
    leaf_ious: Floats
    history: tuple[tuple[int, float], ...]


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
        self.backup = PlanState._make(array.copy() for array in self.state)
        self.best = PlanState._make(array.copy() for array in self.state)

    @staticmethod
    def of(
        trees: Sequence[PlanTree],
        pieces: Sequence[Workpiece],
        targets: Targets,
        n_points: int,
        compared: int = COMPARED,
    ) -> "PlanFit":
        """A plan at a resolution of so many points in all, of which so many of each terminal are compared."""
        volumes = np.array([piece.volume for piece in pieces])
        counts = np.maximum(n_points * volumes / volumes.sum(), FEWEST).astype(np.int64).tolist()
        points = [piece.points[:count] for piece, count in zip(pieces, counts, strict=True)]
        return PlanFit(state_of(list(trees), points, volumes, targets), targets, compared)

    @property
    def iou(self) -> float:
        """Predicted strict IoU of the best plan so far."""
        return float(total_iou(self.best)) / len(self.targets.volumes)

    def iou_of(self, goal: int) -> float:
        """Predicted IoU of a goal fragment in the best plan so far."""
        return float(self.best.iou[np.flatnonzero(self.best.goal == goal)[0]])

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

    def restart(self) -> None:
        """Go back to the best plan so far."""
        copy_plan(self.best, self.state)

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

    def plan(self, history: Sequence[tuple[int, float]]) -> FittedPlan:
        """The best plan so far."""
        leaves = np.flatnonzero(self.best.goal != NONE)
        ious = np.zeros(len(self.targets.volumes))
        ious[self.best.goal[leaves]] = self.best.iou[leaves]
        return FittedPlan(tuple(trees_of(self.best)), self.iou, ious, tuple(history))


def resolution(targets: Targets, points: int, most: int) -> int:
    """Number of points of a whole plan with which a small terminal has so many.

    Args:
        targets: of the goal.
        points: wanted in a terminal of the volume that a share `SMALL` of the goal's fragments does not exceed.
        most: largest number of points of a plan.
    """
    small = float(np.quantile(targets.volumes, SMALL))
    return min(int(points * float(targets.volumes.sum()) / small), most)


def fit(
    starts: Sequence[Sequence[PlanTree]],
    pieces: Sequence[Workpiece],
    targets: Targets,
    settings: FittingSettings,
    budget: Budget,
    rng: np.random.Generator,
) -> FittedPlan:
    """Fit a plan to a goal by three annealings of ever finer resolution; after each the better half is kept.

    Args:
        starts: starting plans, each a tree for every current fragment.
        pieces: the current fragments.
        targets: the goal's fragments, as many as there are leaves in each start.
        settings: resolutions and temperatures.
        budget: of evaluations, and perhaps of time.
        rng: random stream.
    """
    draws = draws_from(rng)
    levels = settings.levels
    contest = _Contest(pieces, targets, settings, budget)
    plans = [tuple(start) for start in starts]
    for plan in plans:
        contest.enter(plan)
    whole = budget.evaluations - budget.spent
    for level, ending in zip(levels, [*(each.hot for each in levels[1:]), settings.cold], strict=True):
        last = level is levels[-1]
        found = []
        for plan in plans:
            share = whole - budget.spent if last else int(level.share * whole / len(plans))
            fitted = contest.at(plan, level)
            history = fitted.run(share, (level.hot, ending), level.restructuring, draws, budget)
            if last:
                contest.record(history)
            found += [(contest.enter(each), i, each) for i, each in enumerate(fitted.ends)]
        found.sort(key=lambda entry: -entry[0])
        plans = [plan for _, _, plan in found[: 1 if level is levels[-2] else (len(plans) + 1) // 2]]
    return contest.result()


def refit(
    plan: Sequence[PlanTree],
    pieces: Sequence[Workpiece],
    targets: Targets,
    settings: FittingSettings,
    budget: Budget,
    rng: np.random.Generator,
) -> FittedPlan:
    """Polish a plan that was fitted before; the arguments are those of `fit`."""
    contest = _Contest(pieces, targets, settings, budget)
    contest.enter(tuple(plan))
    fitted = contest.at(plan, settings.levels[-1])
    share = settings.levels[-1].restructuring
    history = fitted.run(budget.evaluations, (settings.refit_hot, settings.cold), share, draws_from(rng), budget)
    contest.record(history)
    contest.enter(fitted.ends[0])
    return contest.result()


class _Contest:
    """The best plan by the finest resolution, among all that were entered."""

    def __init__(
        self, pieces: Sequence[Workpiece], targets: Targets, settings: FittingSettings, budget: Budget
    ) -> None:
        self.pieces, self.targets, self.budget = pieces, targets, budget
        self.settings = settings
        self.finest = settings.levels[-1]
        self.best: PlanFit | None = None
        self.history: list[tuple[int, float]] = []

    @property
    def iou(self) -> float:
        """Predicted strict IoU of the best plan."""
        return self.best.iou if self.best else -1.0

    def at(self, plan: Sequence[PlanTree], level: FittingLevel) -> PlanFit:
        """A plan at the resolution of a level."""
        n_points = resolution(self.targets, level.points, self.settings.max_points)
        return PlanFit.of(plan, self.pieces, self.targets, n_points, level.compared)

    def enter(self, plan: Sequence[PlanTree]) -> float:
        """Enter a plan; return its predicted strict IoU at the finest resolution."""
        entered = self.at(plan, self.finest)
        if entered.iou > self.iou:
            self.best = entered
        self.record([(self.budget.spent, self.iou)])
        return entered.iou

    def record(self, history: Sequence[tuple[int, float]]) -> None:
        """Continue the history of the best prediction."""
        for spent, iou in history:
            self.history.append((spent, max(iou, self.history[-1][1] if self.history else iou)))

    def result(self) -> FittedPlan:
        """The best plan with the history of the best prediction."""
        assert self.best is not None
        return self.best.plan(self.history)
