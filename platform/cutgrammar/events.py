"""The small closed set of events that a trial emits: their list is its record, and observers watch them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import Cut, Sighted
from cutgrammar.motion import Execution, Motion

DECIDING_SCORE = "iou_strict"
"""The score by which methods are compared and trials are sorted. It is known for every trial."""


def deciding_score(scores: Mapping[str, float | None]) -> float:
    """The value of `DECIDING_SCORE` among `scores`; 0 where they lack it."""
    return scores.get(DECIDING_SCORE) or 0.0


@dataclass(frozen=True, eq=False)
class Planned:
    """A cut was planned.

    Attributes:
        step: number of the cut about to be made, from 1.
        attempt: number of refusals before it in this step.
        cut: the cut.
        seconds: planning time; a record's digest does not cover it.
    """

    step: int
    attempt: int
    cut: Cut
    seconds: float


@dataclass(frozen=True, eq=False)
class CutMade:
    """A cut was made; `configuration` is the true one after it, the other fields are as in `Done`."""

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
        scores: name -> score, None where it is not known (see `trials.scores`).
        fragments: number of fragments reached.
        goal_fragments: number of fragments in the goal.
        pairs: ((reached, goal, IoU), ...) of the matching.
        reason: why no score is known; None if one is.
    """

    scores: Mapping[str, float | None]
    fragments: int
    goal_fragments: int
    pairs: tuple[tuple[int, int, float], ...]
    reason: str | None = None

    @property
    def iou_strict(self) -> float:
        """The deciding score, which is always known."""
        return deciding_score(self.scores)


Event = Sighted | Planned | CutMade | CutRefused | CutFailed | GaveUp | Scored
"""One thing that happened in a trial."""


Observer = Callable[[Event], Any]
"""A function that is called with every event of a trial; its return value is ignored."""
