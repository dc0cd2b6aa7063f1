"""What a run tells those who watch it while it works. Nothing of it decides a result, and any of it may be lost."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cutgrammar.events import Event
from cutgrammar.geometry.fragment import Configuration

Curve = tuple[tuple[float, float], ...]
"""Points ((x, y), ...)."""


@dataclass(frozen=True)
class RunBegan:
    """An evaluation begins or resumes.

    Attributes:
        name: of the run.
        planned: number of its trials.
        workers: number of processes that carry out trials.
        arm: whether an arm makes the cuts.
        cameras: whether planners see by cameras.
        scored: method -> strict IoU of each trial that the ledger already holds.
    """

    name: str
    planned: int
    workers: int
    arm: bool
    cameras: bool
    scored: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class TrialBegan:
    """A worker begins a trial.

    Attributes:
        worker: name of the process.
        title: of the trial.
        start, goal: as given to the planner and the world, in the world frame.
    """

    worker: str
    title: str
    start: Configuration
    goal: Configuration


@dataclass(frozen=True, eq=False)
class TrialEvent:
    """Something happened in the trial of a worker."""

    worker: str
    title: str
    event: Event


@dataclass(frozen=True)
class TrialSaved:
    """The record of a trial is in the ledger.

    Attributes:
        title: of the trial.
        method: its name.
        status: how the trial ended.
        iou_strict: its deciding score.
    """

    title: str
    method: str
    status: str
    iou_strict: float


@dataclass(frozen=True)
class TrainingBegan:
    """A training begins.

    Attributes:
        name: of the model.
    """

    name: str


@dataclass(frozen=True)
class TrainingAdvanced:
    """A stage of a training advanced.

    Attributes:
        stage: its name.
        done, total: how much of it is done, and of how much.
        curve: ((x, y), ...) points that were measured since: epochs and losses, or numbers of types and objectives.
    """

    stage: str
    done: int
    total: int
    curve: Curve = ()


News = RunBegan | TrialBegan | TrialEvent | TrialSaved | TrainingBegan | TrainingAdvanced
"""One thing that a run tells."""

Outlet = Callable[[News], Any]
"""Where news go; it neither blocks nor raises, and may lose them."""
