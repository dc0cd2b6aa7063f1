"""The seams between a method that plans cuts, a world that makes them, and whoever watches.

`run_trial` (in `trials.run`) plays one planner against one world. Every method is a `Planner`, every world a `World`;
what happens is told by a small closed set of events, whose list is the record of the trial.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.plane import Plane

Stream = Callable[..., np.random.Generator]
"""A family of random streams: `stream("purpose", step)` gives the stream of that name (see `seeds.stream`)."""

A = TypeVar("A")
B = TypeVar("B")


class Spread(Protocol):
    """How independent searches are carried out: `spread(f, xs)` is `[f(x) for x in xs]`, wherever each runs."""

    def __call__(self, function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
        """The results in the order of the arguments."""
        ...


# --- what a planner answers -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TreeNode:
    """A node of an inferred parse tree, for those who look at it.

    Attributes:
        parent: index of its parent in the list of nodes, None for the start symbol.
        type: fragment type, None for the start symbol.
        now: index of the current fragment that this node is, None below the current fragments.
        goal: index of the goal fragment that this terminal is grounded to, None for a non-terminal.
    """

    parent: int | None
    type: int | None
    now: int | None = None
    goal: int | None = None


@dataclass(frozen=True)
class Explanation:
    """Why a planner chose a cut.

    Attributes:
        tree: the best parse tree, parents before children.
        production: the production carried out, e.g. "c3 -> c5 c5".
        log_prior, log_shape, log_layout: the three terms of Eq. (3) in logs.
        history: best log posterior after each round of the search.
        rollouts: number of rollouts made.
        dead_ends: how many of them could not derive the goal's number of fragments.
        dead_end: the best parse tree is itself a dead end.
    """

    tree: tuple[TreeNode, ...]
    production: str
    log_prior: float
    log_shape: float
    log_layout: float
    history: tuple[float, ...]
    rollouts: int
    dead_ends: int
    dead_end: bool = False

    @property
    def log_posterior(self) -> float:
        """Log of Eq. (3), up to the constants that `inference.posterior` names."""
        return self.log_prior + self.log_shape + self.log_layout


@dataclass(frozen=True, eq=False)
class Cut:
    """A cut that a planner wants made.

    Attributes:
        plane_W: cutting plane in the world frame.
        p_WC: (k, 3) centroids, in the world frame, of the fragments meant [m].
        explanation: why, where the planner can tell.
    """

    plane_W: Plane
    p_WC: Floats
    explanation: Explanation | None = None


@dataclass(frozen=True)
class Stuck:
    """The planner sees no cut to make."""

    reason: str


# --- what a world answers ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Done:
    """The cut was made.

    Attributes:
        products: number of fragments that the fragments meant became.
    """

    products: int


@dataclass(frozen=True)
class Refused:
    """The world will not make this cut and nothing changed; the planner is asked again and told why."""

    reason: str


@dataclass(frozen=True)
class Failed:
    """The cut went wrong and the trial ends with the configuration reached."""

    reason: str


@dataclass(frozen=True, eq=False)
class Refusal:
    """A cut that was refused in this step, and why."""

    cut: Cut
    reason: str


class Planner(Protocol):
    """A method that plans one cut at a time."""

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """The next cut on the way from `now` to `goal`.

        Args:
            now: the current fragments, as observed, in the world frame.
            goal: the goal's fragments in no particular order, meshes or clouds.
            refused: what was refused so far in this step.
            rng: the stream of this step and attempt.
        """
        ...


class World(Protocol):
    """Where cuts are made. A fresh world serves one trial."""

    def reset(self, start: Configuration) -> None:
        """Lay out the initial configuration."""
        ...

    def observe(self) -> Configuration:
        """The current fragments as this world perceives them."""
        ...

    def truth(self) -> Configuration:
        """The current fragments as they are; for scoring and recording only."""
        ...

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Make the cut, or say why not."""
        ...


# --- what is told of a trial ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Planned:
    """A cut was planned.

    Attributes:
        step: number of the cut about to be made, from 1.
        attempt: number of refusals before it in this step.
        cut: the cut.
        seconds: planning time; not part of what a record's digest covers.
    """

    step: int
    attempt: int
    cut: Cut
    seconds: float


@dataclass(frozen=True, eq=False)
class CutMade:
    """A cut was made; `configuration` is what is truly there now."""

    step: int
    products: int
    configuration: Configuration


@dataclass(frozen=True)
class CutRefused:
    """The world refused a cut."""

    step: int
    attempt: int
    reason: str


@dataclass(frozen=True)
class CutFailed:
    """The world failed at a cut; the trial ends."""

    step: int
    reason: str


@dataclass(frozen=True)
class GaveUp:
    """The planner is stuck, or was refused too often in one step; the trial ends."""

    step: int
    reason: str


@dataclass(frozen=True, eq=False)
class Scored:
    """The configuration reached was scored; the last event of every trial.

    Attributes:
        iou: mean best-matched IoU over the matched pairs (IV-B2), None where no configuration is known.
        iou_strict: the same sum over the larger count.
        fragments: number of fragments reached.
        goal_fragments: number of fragments in the goal.
        pairs: ((reached, goal, IoU), ...) of the matching.
        reason: why there is no score, where there is none.
        iou_refined: sum of the pairs' IoU after their rotation is refined, over the larger count; None where there
            are no volumes to compare.
        spectral: mean spectral distance of the pairs, from 0 (the same) to 1, as which a fragment without counterpart
            counts; None likewise.
        agreement: share, of the larger count, of fragments of the right category and size; None likewise.
    """

    iou: float | None
    iou_strict: float
    fragments: int
    goal_fragments: int
    pairs: tuple[tuple[int, int, float], ...]
    reason: str | None = None
    iou_refined: float | None = None
    spectral: float | None = None
    agreement: float | None = None


Event = Planned | CutMade | CutRefused | CutFailed | GaveUp | Scored
Observer = Callable[[Event], Any]
"""Watches a trial; what it returns is ignored."""


def here(function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
    """The `Spread` of one process: one after another."""
    return [function(argument) for argument in arguments]
