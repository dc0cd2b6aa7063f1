"""Fitting whole plans to a goal: annealings of ever finer resolution, and renewals of the parts that fit worst.

The score of a plan is the strict IoU that virtual cutting predicts: the mean over its terminals of the IoU with the
goal's fragments that they are grounded in, as the score of a trial computes it from meshes. One evaluation is one
change tried: the plan is cut virtually where the change reaches, and scored. The best plan by the finest resolution is
kept, and a start counts too, so that a fitted plan is never worse than its start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.fitting.plan_fit import Budget, PlanFit, resolution
from cutgrammar.fitting.plan_tree import PlanTree
from cutgrammar.fitting.renewal import renewed
from cutgrammar.fitting.targets import Targets
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.arrays import Floats
from cutgrammar.inference.draws import draws_from
from cutgrammar.settings import FittingLevel, FittingSettings


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
            entered = [(contest.enter(each), i, each) for i, each in enumerate(fitted.ends)]
            if level is levels[-2]:
                _, _, better = max(entered, key=lambda entry: entry[0])
                until = budget.spent + int(settings.renewal * whole / len(plans))
                allowed = Budget(min(until, budget.evaluations), budget.deadline, budget.spent)
                better = renewed(contest.at(better, level), settings.renewal_hot, ending, allowed, rng)
                budget.spent = allowed.spent
                entered.append((contest.enter(better), 2, better))
            found += entered
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
        trees, _ = self.best.ends
        return FittedPlan(trees, self.history[-1][1], self.best.leaf_ious, tuple(self.history))
