"""Joint plan fitting: plans a whole tree of cuts and fits all its planes to the goal's fragments by virtual cutting.

The first step fits a plan from `fitting.n_starts` starting plans with most of the trial's budget. After every cut the
rest of the plan is carried over to the fragments that are there and fitted again from where it stands, with a share
of what is left. After a refusal another fragment's cut is tried first, then the planes are turned and shifted a
little more each time. The fitting uses the goal's shapes and not its layout, which only the search for starting plans
may read.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutgrammar.fitting.carry_over import carry_over, expected_after
from cutgrammar.fitting.fit import FittedPlan, fit, refit
from cutgrammar.fitting.plan_fit import FEWEST, Budget, resolution
from cutgrammar.fitting.plan_tree import Branch, Leaf, PlanTree, goals_of
from cutgrammar.fitting.starting_plans import StartingPlans, halving_plans, peeling_plans
from cutgrammar.fitting.targets import Targets, targets_of
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.fragment import Configuration, Fragment, same_configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Explanation, Refusal, Stuck, TreeNode
from cutgrammar.methods.guided_structures import GrammarPlans
from cutgrammar.methods.method import Method, PlanningContext
from cutgrammar.settings import FittingSettings

MANY, MOST = 16, 50
"""Goals of more than `MANY` fragments get more evaluations for each, in proportion, but `MOST` times the setting."""
TURN, SHIFT = 0.05, 0.03
"""After a refusal a plane is turned by this angle [rad] and shifted by this share of the fragment's size, at first."""


@dataclass(frozen=True, eq=False)
class _Step:
    """The plan of a step and what it was made for."""

    now: Configuration
    goal: Configuration
    pieces: tuple[Workpiece, ...]
    plan: FittedPlan
    chosen: int | None = None


class GuidedPlanner:
    """Fits whole plans; keeps the plan of the previous step and the prepared goal."""

    def __init__(self, starts: StartingPlans, settings: FittingSettings) -> None:
        self._starts = starts
        self._settings = settings
        self._step: _Step | None = None
        self._targets: tuple[Configuration, tuple[int, ...], Targets] | None = None
        self._first_count = 0

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The next cut of the fitted plan (see `Planner`)."""
        if len(now) >= len(goal):
            return Stuck(f"there are {len(now)} fragments already and the goal has {len(goal)}")
        if self._targets is None or not same_configuration(self._targets[0], goal):
            order = tuple(sorted(range(len(goal)), key=lambda j: -round(goal[j].shape.volume * 1e9, 6)))
            self._targets = goal, order, targets_of([goal[j] for j in order])
            self._step = None
        step = self._step
        if not (refused and step and same_configuration(step.now, now)):
            step = self._fitted(now, goal, rng)
        open_pieces = [i for i, tree in enumerate(step.plan.trees) if isinstance(tree, Branch)]
        chosen = open_pieces[len(refused) % len(open_pieces)]
        self._step = _Step(step.now, step.goal, step.pieces, step.plan, chosen)
        tree, piece = step.plan.trees[chosen], step.pieces[chosen]
        assert isinstance(tree, Branch)
        assert tree.normal is not None
        assert tree.offset is not None
        plane_C = Plane(tree.normal, tree.offset)
        if rounds := len(refused) // len(open_pieces):
            size = rounds * SHIFT * piece.volume ** (1.0 / 3.0)
            turned = plane_C.normal + rounds * TURN * rng.normal(size=3)
            plane_C = Plane(turned / np.linalg.norm(turned), plane_C.offset + size * float(rng.normal()))
        return Cut.of_fragment(now[chosen], plane_C, piece.X_FC, _explanation(step.plan, tree, self._targets[1]))

    def _fitted(self, now: Configuration, goal: Configuration, rng: np.random.Generator) -> _Step:
        """The plan of a new step."""
        settings, previous = self._settings, self._step
        assert self._targets is not None
        targets = self._targets[2]
        wanted = resolution(targets, settings.levels[-1].points, settings.max_points)
        total = sum(fragment.shape.volume for fragment in now)
        pieces = tuple(
            self._workpiece(fragment, max(int(wanted * fragment.shape.volume / total), FEWEST)) for fragment in now
        )
        if previous is None:
            self._first_count = len(now)
            ordered = tuple(goal[j] for j in self._targets[1])
            starts = self._starts(now, ordered, pieces, targets, settings.n_starts, rng)
            plan = fit(starts, pieces, targets, settings, self._budget(settings.first_share, len(goal)), rng)
        else:
            share = (1.0 - settings.first_share) / max(len(goal) - self._first_count - 1, 1)
            expected = expected_after(previous.plan.trees, previous.pieces, previous.chosen)
            carried = carry_over(expected, pieces, targets)
            plan = refit(carried, pieces, targets, settings, self._budget(share, len(goal)), rng)
        return _Step(now, goal, pieces, plan)

    def _workpiece(self, fragment: Fragment, n_points: int) -> Workpiece:
        """A fragment prepared, again only if the previous step had not the same shape with as many points."""
        if self._step is not None:
            for known, piece in zip(self._step.now, self._step.pieces, strict=True):
                if known.shape is fragment.shape and len(piece.points) == n_points:
                    return replace(piece, X_WC=fragment.X_WF @ piece.X_FC)
        return Workpiece.of(fragment, n_points)

    def _budget(self, share: float, n_goal: int) -> Budget:
        """A share of what a trial with so many fragments in the goal may spend."""
        seconds = self._settings.seconds * n_goal * share
        deadline = time.monotonic() + seconds if seconds else None
        shares = min(n_goal * max(n_goal / MANY, 1.0), MOST)
        return Budget(max(int(share * self._settings.evaluations * shares), 1), deadline)


def _explanation(plan: FittedPlan, cut: Branch, order: Sequence[int]) -> Explanation:
    """The fitted plan as a tree, whose leaves count the goal's fragments in this order.

    Its nodes have no types.
    """
    nodes = [TreeNode(parent=None, type=None)]

    def add(tree: PlanTree, parent: int, now: int | None) -> None:
        nodes.append(TreeNode(parent, None, now, order[tree.goal] if isinstance(tree, Leaf) else None))
        index = len(nodes) - 1
        if isinstance(tree, Branch):
            add(tree.below, index, None)
            add(tree.above, index, None)

    for i, tree in enumerate(plan.trees):
        add(tree, 0, i)
    return Explanation(
        tree=tuple(nodes),
        production=" | ".join(_named([order[g] for g in goals_of(side)]) for side in (cut.below, cut.above)),
        log_prior=0.0,
        log_shape=0.0,
        log_layout=0.0,
        history=tuple(iou for _, iou in plan.history),
        rollouts=plan.history[-1][0],
        dead_ends=0,
        predicted_iou=plan.iou,
    )


def _named(goals: list[int]) -> str:
    return " ".join(f"g{goal}" for goal in sorted(goals))


def make_guided(context: PlanningContext) -> GuidedPlanner:
    """A planner whose starting plans come from the source that the settings name."""
    structures = context.settings.fitting.structures
    source: StartingPlans
    if structures == "halve":
        source = halving_plans
    elif structures == "peel":
        source = peeling_plans
    else:
        source = GrammarPlans(context.model, context.settings, context.parallel_map, structures)
    return GuidedPlanner(source, context.settings.fitting)


GUIDED = Method(
    "guided",
    make_guided,
    description="plans whole trees of cuts and fits all their planes to the goal's fragments by virtual cutting; uses "
    "the goal's geometry",
    position=2,
)
