"""The small closed set of events that a trial emits: their list is its record, and observers watch them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import Cut, Sighted
from cutgrammar.motion import Execution, Motion


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
"""What a trial emits."""


Observer = Callable[[Event], Any]
"""Watches a trial; what it returns is ignored."""
