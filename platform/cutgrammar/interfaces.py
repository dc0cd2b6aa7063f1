"""The interfaces between a planner, which plans cuts, and a world, which makes them.

Every method is a `Planner`, every world a `World`; `trials.run_trial` plays one against the other.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.motion import Execution, Motion

A = TypeVar("A")
B = TypeVar("B")

Stream = Callable[..., np.random.Generator]
"""A family of random streams: `stream("purpose", step)` gives the stream of that name (see `seeds.stream`)."""


class ParallelMap(Protocol):
    """Carries out independent calls: `parallel_map(f, xs)` is `[f(x) for x in xs]`, wherever each call runs."""

    def __call__(self, function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
        """The results in the order of the arguments."""
        ...


def run_serially(function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
    """The `ParallelMap` that makes one call after another in this process."""
    return [function(argument) for argument in arguments]


@dataclass(frozen=True)
class TreeNode:
    """A node of an inferred parse tree, as recordings and figures show it.

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
        history: best log posterior, or predicted strict IoU, after each round of the search.
        rollouts: number of rollouts made.
        dead_ends: how many of them could not derive the goal's number of fragments.
        dead_end: the best parse tree is itself a dead end.
        log_volume: the volume term that `grammar-plus` adds, in logs; None for a method without it.
        predicted_iou: strict IoU that the plan is predicted to reach, for a method that ranks plans by it and not by
            their posterior.
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
    log_volume: float | None = None
    predicted_iou: float | None = None

    @property
    def log_posterior(self) -> float:
        """Log of Eq. (3), up to the constants that `inference.posterior` names."""
        return self.log_prior + self.log_shape + self.log_layout + (self.log_volume or 0.0)


@dataclass(frozen=True, eq=False)
class Cut:
    """A cut that a planner asks a world to make.

    Attributes:
        plane_W: cutting plane in the world frame.
        p_WC: (k, 3) centroids, in the world frame, of the fragments to cut [m].
        explanation: why this cut was chosen; None if the planner does not say.
    """

    plane_W: Plane
    p_WC: Floats
    explanation: Explanation | None = None

    @staticmethod
    def of_fragment(fragment: Fragment, plane_A: Plane, X_FA: Pose, explanation: Explanation | None = None) -> "Cut":
        """The cut of one fragment along a plane in frame A, whose pose in the fragment's frame F is X_FA."""
        return Cut(plane_A.transformed(fragment.X_WF @ X_FA), fragment.p_WC[None], explanation)


@dataclass(frozen=True)
class Stuck:
    """The planner finds no cut to make."""

    reason: str


@dataclass(frozen=True)
class Done:
    """The cut was made.

    Attributes:
        products: number of fragments that the cut ones became.
        execution, motion: how a robot made the cut; None where no robot did.
    """

    products: int
    execution: Execution | None = None
    motion: Motion | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Refused:
    """The world does not make this cut and nothing has changed; the planner plans again, given the reason."""

    reason: str


@dataclass(frozen=True)
class Failed:
    """The cut went wrong and the trial ends with the configuration reached."""

    reason: str


@dataclass(frozen=True, eq=False)
class Refusal:
    """A cut that was refused in the current step, and why."""

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
            refused: the cuts refused so far in this step.
            rng: the random stream of this step and attempt.
        """
        ...


class World(Protocol):
    """Makes cuts. Each trial gets a fresh world."""

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration.

        Args:
            start: fragments with meshes, in the world frame.
            foods: name of the food of each, where known; only worlds with forces use it.
        """
        ...

    def observe(self) -> Configuration:
        """The current fragments as this world perceives them."""
        ...

    def truth(self) -> Configuration:
        """The current fragments as they are; for scoring and recording only."""
        ...

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Make the cut, or return why it was not made."""
        ...


@runtime_checkable
class SeesWithCameras(Protocol):
    """A world that perceives by cameras and keeps what they saw."""

    def sighted(self, step: int) -> "Sighted":
        """What the last `observe()` saw, before the cut of number `step` is planned."""
        ...


@dataclass(frozen=True, eq=False)
class Sighted:
    """What cameras saw before a cut was planned.

    Attributes:
        step: number of the cut about to be planned, from 1.
        points: (n, 3) fused points in W [m].
        labels: (n,) the fragment that the segmentation gave each point to, -1 for none.
        owners: (n,) the true fragment of each point.
        configuration: the fragments as perceived.
    """

    step: int
    points: Floats
    labels: Ints
    owners: Ints
    configuration: Configuration
