"""The seams between a method that plans cuts, a world that makes them, and whoever watches.

`run_trial` (in `trials.run`) plays one planner against one world. Every method is a `Planner`, every world a `World`;
what happens is told by a small closed set of events, whose list is the record of the trial.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Configuration, Mesh
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


# --- how a robot carries a cut out ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of a robot or its tool, as it looks.

    Attributes:
        name: of the part.
        mesh: its surface in the part's frame L [m].
    """

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Phase:
    """A stretch of a motion in which the same fragments are there.

    Attributes:
        name: "transit", "pick", "carry", "place", "approach", "press", "retreat", "settle".
        first: index of its first sample in the motion's times; it lasts until the next phase begins.
        fragments: what is there, as it lies when the phase begins.
        poses: (k, f, 7) X_WF of the f fragments at the phase's k samples, or None where they all stand still.
    """

    name: str
    first: int
    fragments: Configuration
    poses: Floats | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """All that a robot did for one cut, sample by sample: to look at, to check, to hand on to a real arm.

    Attributes:
        times: (t,) since the motion began [s], ascending.
        joints: names of the j joints.
        positions, velocities: (t, j) of the joints [rad, rad/s].
        torques: (t, j) that the motors bear: drive and gravity [N m].
        position_limits, velocity_limits, torque_limits: (j, 2), (j,), (j,); positions of a joint without end are
            bounded by -inf and inf.
        wrench_W: (t, 6) force and torque of the tool on the flange, about the flange's origin, axes of W [N, N m].
        blade_force: (t,) of the food on the blade's edge and sides, against the movement [N].
        links: the l parts of the robot and its tool.
        poses: (t, l, 7) X_WL of every part (position, quaternion w x y z).
        X_WB: (t, 7) of the blade: origin in the middle of its edge, y along the edge, z from the edge to the back.
        phases: what was done when.
    """

    times: Floats
    joints: tuple[str, ...]
    positions: Floats
    velocities: Floats
    torques: Floats
    position_limits: Floats
    velocity_limits: Floats
    torque_limits: Floats
    wrench_W: Floats
    blade_force: Floats
    links: tuple[Link, ...]
    poses: Floats
    X_WB: Floats
    phases: tuple[Phase, ...]


@dataclass(frozen=True)
class Execution:
    """A robot's cut in numbers; part of the record.

    Attributes:
        why_moved: why the fragment was moved before it was cut, None where it was cut where it lay.
        turned_deg: by how much it was turned [degrees].
        carried: how far its centroid was carried [m].
        plane_error_deg, plane_error_mm: greatest angle between the plane meant and the blade's, and greatest distance
            between the two within the section, while the blade was in the fragment [degrees, mm].
        seconds: simulated time of the whole motion [s].
        blade_force: greatest force on the blade [N].
        torque_share, velocity_share: greatest share of its limit that any joint's torque and velocity reached.
        limits_kept: no joint left its range, and no velocity or torque its limit.
    """

    why_moved: str | None
    turned_deg: float
    carried: float
    plane_error_deg: float
    plane_error_mm: float
    seconds: float
    blade_force: float
    torque_share: float
    velocity_share: float
    limits_kept: bool


# --- what a world answers ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Done:
    """The cut was made.

    Attributes:
        products: number of fragments that the fragments meant became.
        execution, motion: how a robot did it, where one did.
    """

    products: int
    execution: Execution | None = None
    motion: Motion | None = field(default=None, compare=False, repr=False)


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

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration.

        Args:
            start: meshes, in W.
            foods: what each of them is, by name, where that is known; it matters to worlds with forces only.
        """
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


@runtime_checkable
class Sees(Protocol):
    """A world that perceives by cameras, and can tell what they saw."""

    def sighted(self, step: int) -> "Sighted":
        """What the last `observe()` saw, before the cut of number `step` is planned."""
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
    """A cut was made; `configuration` is what is truly there now, the rest as in `Done`."""

    step: int
    products: int
    configuration: Configuration
    execution: Execution | None = None
    motion: Motion | None = None


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


Event = Sighted | Planned | CutMade | CutRefused | CutFailed | GaveUp | Scored
Observer = Callable[[Event], Any]
"""Watches a trial; what it returns is ignored."""


def here(function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
    """The `Spread` of one process: one after another."""
    return [function(argument) for argument in arguments]
