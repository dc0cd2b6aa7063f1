"""What the record of a trial may hold, and the key that decides it; `record` makes objects of what passes."""

from typing import Annotated, Any, Literal, NotRequired

from pydantic import AfterValidator, Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.trials.goals import GOALS
from cutgrammar.untrusted import check, parse_exact
from cutgrammar.untrusted.kinds import (
    OPEN,
    STRICT,
    Digest,
    Identifier,
    Number,
    Seconds,
    Small,
    Text,
    Version,
    Word,
    fixed,
)

SHARES = ("iou", "iou_strict", "iou_refined", "spectral", "agreement")
"""The scores that are between 0 and 1; others are any finite numbers."""
ROUNDING = 1e-6


def _scores(scores: dict[str, float | None]) -> dict[str, float | None]:
    for name in SHARES:
        value = scores.get(name)
        if value is not None and not -ROUNDING <= value <= 1.0 + ROUNDING:
            raise ValueError(f"{name} is {value:g}; 0 to 1 is expected")
    return scores


Scores = Annotated[dict[Identifier, Number | None], Field(max_length=1_000), AfterValidator(_scores)]


@with_config(STRICT)
class KeyFacts(TypedDict):
    """A key: see `record.TrialKey`."""

    setup: Word
    trial: Small
    goals: Literal[GOALS]  # type: ignore[valid-type]
    method: Word
    run: Small
    world: Word
    perception: Word
    origin: Digest


@with_config(OPEN)
class PlannedFacts(TypedDict):
    """A cut was planned."""

    event: Literal["Planned"]
    step: Small
    attempt: Small
    seconds: Seconds
    plane_W: fixed(Number, 4)  # type: ignore[valid-type]
    p_WC: list[fixed(Number, 3)]  # type: ignore[valid-type]
    production: NotRequired[Text | None]
    predicted_iou: NotRequired[Number | None]
    log_prior: NotRequired[Number | None]
    log_shape: NotRequired[Number | None]
    log_layout: NotRequired[Number | None]
    log_posterior: NotRequired[Number | None]
    log_volume: NotRequired[Number | None]
    rollouts: NotRequired[Small]
    dead_ends: NotRequired[Small]
    dead_end: NotRequired[bool]


@with_config(OPEN)
class ExecutionFacts(TypedDict):
    """How an arm made a cut: see `motion.Execution`."""

    why_moved: Text | None
    turned_deg: Number
    carried: Number
    plane_error_deg: Number
    plane_error_mm: Number
    seconds: Seconds
    blade_force: Number
    torque_share: Number
    velocity_share: Number
    limits_kept: bool


@with_config(OPEN)
class CutMadeFacts(TypedDict):
    """A cut was made."""

    event: Literal["CutMade"]
    step: Small
    products: Small
    fragments: Small
    execution: NotRequired[ExecutionFacts]


@with_config(OPEN)
class CutRefusedFacts(TypedDict):
    """The world refused a cut."""

    event: Literal["CutRefused"]
    step: Small
    attempt: Small
    reason: Text


@with_config(OPEN)
class EndFacts(TypedDict):
    """The world failed at a cut, or the planner gave up."""

    event: Literal["CutFailed", "GaveUp"]
    step: Small
    reason: Text


@with_config(OPEN)
class SightedFacts(TypedDict):
    """Cameras saw the configuration."""

    event: Literal["Sighted"]
    step: Small
    points: Small
    seen: Small
    there: Small
    unassigned: Small


@with_config(OPEN)
class ScoredFacts(TypedDict):
    """The configuration reached was scored."""

    event: Literal["Scored"]
    scores: Scores
    fragments: Small
    goal_fragments: Small
    pairs: list[fixed(Number, 3)]  # type: ignore[valid-type]
    reason: Text | None


def _pairs(event: Any) -> Any:
    """Check that the pairs of a `Scored` are of fragments that there are."""
    for reached, goal, iou in event["pairs"]:
        is_one = reached in range(event["fragments"]) and goal in range(event["goal_fragments"])
        if not is_one or not -ROUNDING <= iou <= 1.0 + ROUNDING:
            raise ValueError(f"the pair {reached:g}, {goal:g} with IoU {iou:g} is none of its fragments")
    return event


Scored = Annotated[ScoredFacts, AfterValidator(_pairs)]
Event = Annotated[
    PlannedFacts | CutMadeFacts | CutRefusedFacts | EndFacts | SightedFacts | Scored, Field(discriminator="event")
]


@with_config(OPEN)
class RecordFacts(TypedDict):
    """A record: see `record.Record`, which knows the names that may be there."""

    key: KeyFacts
    package: Version
    render: Text | None
    status: Text
    reason: Text | None
    traceback: Text | None
    scores: Scores
    fragments: Small | None
    goal_fragments: Small
    cuts: Small
    refusals: Small
    dead_ends: Small
    planning_seconds: Seconds
    seconds: Seconds
    events: Annotated[list[Event], Field(max_length=1_000_000)]
    model: NotRequired[Digest | None]


_RECORD = TypeAdapter(RecordFacts)
_KEY = TypeAdapter(KeyFacts)


def check_record(data: Any) -> None:
    """Check the record of a trial as plain data.

    Raises:
        ValueError: something is missing or wrong; the message names it.
    """
    check(_RECORD, data)


def parse_record(content: bytes) -> Any:
    """The record of a trial in JSON as plain data, if it fits and has no other names; None otherwise."""
    return parse_exact(_RECORD, content)


def check_key(data: Any) -> None:
    """Check the key of a trial as plain data.

    Raises:
        ValueError: something is missing or wrong; the message names it.
    """
    check(_KEY, data)
