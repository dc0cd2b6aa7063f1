"""The frozen record of one trial: what decided its result, how it ended, its scores and its events."""

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any

import orjson

from cutgrammar.events import CutFailed, CutMade, CutRefused, Event, GaveUp, Planned, Scored, deciding_score
from cutgrammar.interfaces import Explanation, Sighted
from cutgrammar.trials.record_schema import check_record, parse_record
from cutgrammar.trials.scores import Score
from cutgrammar.untrusted import parse_json, shortened

STATUSES = ("done", "stuck", "failed", "crashed", "timeout")
"""How a trial ends: the goal's number of fragments was reached; the planner gave up or was refused too often; the world
failed at a cut; an exception, or the death of its process; it exceeded its time limit
twice (`trial.max_seconds`)."""

UNFINISHED = ("crashed", "timeout")
"""The statuses of trials that something broke off: what they reached is not their end."""

FAILURES = ("failed", *UNFINISHED)
"""The statuses that tables count as failures; a trial that is stuck ended by the method's own decision."""

SHOWN_EVENTS = ("CutMade", "CutRefused", "CutFailed", "Scored")
"""The events that reports count or show."""

SCHEMA_1_SCORES = ("iou", "iou_strict", "iou_refined", "spectral", "agreement")
"""The scores that records had before they held a mapping."""

_CANONICAL = orjson.OPT_SORT_KEYS | orjson.OPT_SERIALIZE_NUMPY
"""How a record is written for its digest; scores may be NumPy's floating-point numbers until they are in a ledger."""


@dataclass(frozen=True, order=True)
class TrialKey:
    """All that decides the result of a trial.

    Attributes:
        setup: name of the setup.
        trial: number within the data set.
        goals: goal condition, e.g. "in-place".
        method, world, perception: by name.
        run: seed of planning and execution within the evaluation and, where it has several models, number of the model.
        origin: digest of seed, settings, data, split, model and package version (see `run_folder`).
    """

    setup: str
    trial: int
    goals: str
    method: str
    run: int
    world: str
    perception: str
    origin: str

    @property
    def values(self) -> tuple[Any, ...]:
        """The attributes in this order, which are sorted faster than keys."""
        return _VALUES(self)

    @property
    def name(self) -> str:
        """The trial's name within its run folder, e.g. "N1M1-12-in-place-grammar-0-board-truth"."""
        parts = (self.setup, self.trial, self.goals, self.method, self.run, self.world, self.perception)
        return "-".join(map(str, parts))

    @cached_property
    def digest(self) -> str:
        """sha256 of the key."""
        return hashlib.sha256(json.dumps(self.to_json(), sort_keys=True, allow_nan=False).encode()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return dict(zip(self.__dataclass_fields__, _VALUES(self), strict=True))  # `asdict` takes eight times as long


_VALUES = attrgetter(*TrialKey.__dataclass_fields__)


@dataclass(frozen=True)
class Record:
    """The record of one trial.

    Attributes:
        key: what decided its result.
        package: version of cutgrammar.
        render: name of the render backend, where the world has one.
        status: one of `STATUSES`.
        reason: why the trial did not end as done; None if it did.
        traceback: where it crashed, None otherwise.
        scores: name -> score (see `trials.scores`): the worst where no configuration is known, None where the score
            itself is not known.
        fragments: number of fragments reached, None where it is not known.
        goal_fragments: number of fragments in the goal.
        cuts: number of cuts made.
        refusals: number of cuts refused.
        dead_ends: number of cuts planned from a parse tree that could not derive the goal.
        planning_seconds, seconds: time spent planning, and in all.
        events: what happened, as JSON data without meshes.
        model: digest of the trained model; None in records that were made before they held it.
    """

    key: TrialKey
    package: str
    render: str | None
    status: str
    reason: str | None
    traceback: str | None
    scores: Mapping[str, float | None]
    fragments: int | None
    goal_fragments: int
    cuts: int
    refusals: int
    dead_ends: int
    planning_seconds: float
    seconds: float
    events: tuple[Mapping[str, Any], ...]
    model: str | None = None

    @property
    def iou_strict(self) -> float:
        """The deciding score."""
        return deciding_score(self.scores)

    @cached_property
    def digest(self) -> str:
        """sha256 of all but the times and the traceback as JSON with sorted names; equal for equal results."""
        data = self.to_json()
        for name in ("planning_seconds", "seconds", "traceback"):
            del data[name]
        data["events"] = [
            {k: v for k, v in event.items() if k != "seconds"} if "seconds" in event else event
            for event in data["events"]
        ]
        return hashlib.sha256(orjson.dumps(data, option=_CANONICAL)).hexdigest()

    def condensed(self) -> "Record":
        """This record with its digest, but of its events only those that reports show: a small part of them.

        Cuts that were planned, and what cameras saw, are left out; of the scoring the pairs stay.
        """
        kept = tuple(
            {"event": "Scored", "pairs": event["pairs"]} if event["event"] == "Scored" else event
            for event in self.events
            if event["event"] in SHOWN_EVENTS and (event["event"] != "CutMade" or "execution" in event)
        )
        condensed = dataclasses.replace(self, events=kept)
        condensed.__dict__["digest"] = self.digest  # where `cached_property` keeps it
        return condensed

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        data = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return data | {"key": self.key.to_json(), "events": list(self.events)}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> "Record":
        """The inverse of `to_json`; reads the flat records of ledgers with schema 1, too.

        Raises:
            TypeError, ValueError: not such data.
        """
        if not isinstance(data, Mapping):
            raise TypeError(f"{shortened(data)} is not a table")
        if "scores" not in data and isinstance(data.get("events"), list):
            events = [nest_scores(event) if _is_scored(event) else event for event in data["events"]]
            data = {**nest_scores(data), "events": events}
        check_record(data)
        return Record._from_checked(data)

    @staticmethod
    def from_text(content: bytes) -> "Record":
        """The same from JSON.

        Raises:
            TypeError, ValueError: not such data.
        """
        data = parse_record(content)
        return Record.from_json(parse_json(content)) if data is None else Record._from_checked(data)

    @staticmethod
    def _from_checked(data: Mapping[str, Any]) -> "Record":
        rest = {name: value for name, value in data.items() if name not in ("key", "events")}
        record = Record(key=TrialKey(**data["key"]), events=tuple(data["events"]), **rest)
        if record.status not in STATUSES:
            raise ValueError(f"status {shortened(record.status)} is not one of {', '.join(STATUSES)}")
        return record


def _is_scored(event: Any) -> bool:
    return isinstance(event, Mapping) and event.get("event") == "Scored"


def nest_scores(flat: Mapping[str, Any]) -> dict[str, Any]:
    """A record or event of schema 1, which held its five scores side by side with all else, with a mapping of them."""
    rest = {name: value for name, value in flat.items() if name not in SCHEMA_1_SCORES}
    return rest | {"scores": {name: flat.get(name) for name in SCHEMA_1_SCORES}}


def record_of(
    key: TrialKey,
    events: Sequence[Event],
    *,
    package: str,
    model: str | None = None,
    render: str | None = None,
    seconds: float,
    crash: tuple[str, str] | None = None,
) -> Record:
    """The record of a trial from its events, of which the last is a `Scored`.

    Args:
        key: what decided it.
        events: all of them.
        package: version of cutgrammar.
        model: digest of the trained model.
        render: the world's render backend.
        seconds: that the trial took.
        crash: one line and a traceback, if it ended by an exception.
    """
    scored = events[-1]
    assert isinstance(scored, Scored)
    planned = [event for event in events if isinstance(event, Planned)]
    status, reason = _ending(events, crash)
    return Record(
        key=key,
        package=package,
        render=render,
        status=status,
        reason=reason,
        traceback=crash[1] if crash else None,
        scores=scored.scores,
        fragments=scored.fragments,
        goal_fragments=scored.goal_fragments,
        cuts=sum(isinstance(event, CutMade) for event in events),
        refusals=sum(isinstance(event, CutRefused) for event in events),
        dead_ends=sum(event.cut.explanation is not None and event.cut.explanation.dead_end for event in planned),
        planning_seconds=sum((event.seconds for event in planned), 0.0),
        seconds=seconds,
        events=tuple(_event_data(event) for event in events),
        model=model,
    )


def record_of_death(
    key: TrialKey,
    goal_fragments: int,
    *,
    package: str,
    model: str | None = None,
    status: str = "crashed",
    reason: str,
    traceback: str,
    scores: Iterable[Score],
) -> Record:
    """The record of a trial whose process died or was stopped: each of `scores` has its worst value."""
    return Record(
        key=key,
        package=package,
        render=None,
        status=status,
        reason=reason,
        traceback=traceback or None,
        scores={score.name: score.worst for score in scores},
        fragments=None,
        goal_fragments=goal_fragments,
        cuts=0,
        refusals=0,
        dead_ends=0,
        planning_seconds=0.0,
        seconds=0.0,
        events=(),
        model=model,
    )


def _ending(events: Sequence[Event], crash: tuple[str, str] | None) -> tuple[str, str | None]:
    if crash:
        return "crashed", crash[0]
    for event in events:
        if isinstance(event, GaveUp):
            return "stuck", event.reason
        if isinstance(event, CutFailed):
            return "failed", event.reason
    return "done", None


def _event_data(event: Event) -> dict[str, Any]:
    """An event as plain data, with the name of its kind and without meshes."""
    data: dict[str, Any] = {"event": type(event).__name__}
    match event:
        case Planned(step, attempt, cut, seconds):
            data |= {"step": step, "attempt": attempt, "seconds": seconds}
            data |= {"plane_W": cut.plane_W.to_vector().tolist(), "p_WC": cut.p_WC.tolist()}
            data |= _explained(cut.explanation) if cut.explanation else {}
        case Sighted(step, points, labels, owners, configuration):
            data |= {"step": step, "points": len(points), "seen": len(configuration), "there": int(owners.max()) + 1}
            data |= {"unassigned": int((labels < 0).sum())}
        case CutMade(step, products, configuration, execution):
            data |= {"step": step, "products": products, "fragments": len(configuration)}
            data |= {"execution": dataclasses.asdict(execution)} if execution else {}
        case Scored():
            data |= dataclasses.asdict(event) | {"pairs": [list(pair) for pair in event.pairs]}
        case _:
            data |= dataclasses.asdict(event)
    return data


def _explained(why: Explanation) -> dict[str, Any]:
    if why.predicted_iou is not None:
        scores = {"predicted_iou": float(why.predicted_iou)}
    else:
        names = ("log_prior", "log_shape", "log_layout", "log_posterior")
        scores = {name: float(getattr(why, name)) for name in names}
        if why.log_volume is not None:
            scores["log_volume"] = float(why.log_volume)
    return {
        "production": why.production,
        **{name: value if math.isfinite(value) else None for name, value in scores.items()},
        "rollouts": int(why.rollouts),
        "dead_ends": int(why.dead_ends),
        "dead_end": bool(why.dead_end),
    }
