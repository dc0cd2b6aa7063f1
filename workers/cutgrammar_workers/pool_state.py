"""What a pool of actors knows of its actors and of its tasks, and when a task is given up."""

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from cutgrammar_workers.tasks import MAX_DEATHS, MAX_OVERTIMES, Crashed, OnFault, Tasks, TimedOut, gave_up
from cutgrammar_workers.worker_actor import Place


@dataclass(eq=False)
class PooledActor:
    """An actor of the pool.

    Attributes:
        handle: Ray's handle of the `WorkerActor`.
        starting: the pending answer while the actor waits for a CPU, builds its worker or lets that wait, then None.
        is_building: it builds its worker.
        tasks: pending result -> index of the task.
        has_suspect: its only task is a suspect.
        place: where it runs, once its process is there.
        since: when it began to build, or its first task of now came to be the first [s], by `time.monotonic`.
    """

    handle: Any
    starting: Any
    is_building: bool = False
    tasks: dict[Any, int] = field(default_factory=dict)
    has_suspect: bool = False
    place: Place | None = None
    since: float = 0.0

    @property
    def host_and_pid(self) -> tuple[str | None, int | None]:
        """Where its process is, as far as that is known."""
        return (None, None) if self.place is None else (self.place.host, self.place.pid)


@dataclass(eq=False)
class TaskQueue:
    """The tasks of one run that are still to be handed out, and which of them are given up.

    Attributes:
        tasks: all tasks.
        waiting: indices of those not handed out yet.
        suspects: indices of those that were in flight on an actor that died.
        on_fault: told of faults of the machine.
        max_faults: the failure budget of a task.
        deaths: index -> number of processes that it ended by its own doing.
        faults: index -> number of faults of the machine that it met.
        overtimes: index -> number of times that it exceeded its time limit.
    """

    tasks: Tasks
    waiting: deque[int]
    on_fault: OnFault
    max_faults: int
    suspects: deque[int] = field(default_factory=deque)
    deaths: Counter[int] = field(default_factory=Counter)
    faults: Counter[int] = field(default_factory=Counter)
    overtimes: Counter[int] = field(default_factory=Counter)

    def repeat_after_fault(self, index: int, result: Crashed) -> tuple[int, Crashed] | None:
        """Try a task again that met a fault of the machine; (index, result) when its budget is used up."""
        self.on_fault(index, result)
        self.faults[index] += 1
        if self.faults[index] >= self.max_faults:
            return index, result
        self.suspects.append(index)
        return None

    def repeat_after_death(self, index: int, result: Crashed) -> tuple[int, Crashed] | None:
        """Try a task again that ended its process by its own doing; (index, result) if it is given up."""
        self.deaths[index] += 1
        if self.deaths[index] == MAX_DEATHS:
            return index, gave_up(result, MAX_DEATHS)
        self.suspects.append(index)
        return None

    def repeat_after_overtime(self, index: int, result: TimedOut) -> tuple[int, TimedOut] | None:
        """Try a task again that took too long; (index, result) if it is given up."""
        self.overtimes[index] += 1
        if self.overtimes[index] == MAX_OVERTIMES:
            return index, result
        self.suspects.append(index)
        return None
