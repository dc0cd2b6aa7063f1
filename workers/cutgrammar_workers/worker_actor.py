"""The class of the Ray actors of a pool: it builds a worker and calls it."""

import os
import signal
import socket
from dataclasses import dataclass
from typing import Any

import ray

from cutgrammar.errors import InputError
from cutgrammar_workers.own_process import OwnProcess
from cutgrammar_workers.tasks import Unfit, Worker, WorkerFactory, attempt, build, is_fault_of_machine, timed_out
from cutgrammar_workers.time_limit import OutOfTime


@dataclass(frozen=True)
class Place:
    """Where an actor runs.

    Attributes:
        node: Ray's id of the node.
        host: name of its machine.
        pid: process id.
    """

    node: str
    host: str
    pid: int


class WorkerActor:
    """Carries out tasks, in its own process or in a child.

    Args:
        max_start_seconds: time limit for building a worker [s].
    """

    def __init__(self, max_start_seconds: float) -> None:
        # Ray's handler raises SystemExit wherever the process is, which looks as if the method had left by it.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        self._max_start_seconds = max_start_seconds
        self._worker: Worker | None = None

    def place(self) -> Place:
        """Where it is; the answer shows that its process is there."""
        return Place(ray.get_runtime_context().get_node_id(), socket.gethostname(), os.getpid())

    def build(self, make_worker: WorkerFactory, shared: Any) -> Unfit | bool:
        """Build the worker; why that is not possible, or whether it has to `wait` before its first task.

        An exception that says nothing of this node would recur for every task, so it ends the run.
        """
        self._make_worker, self._shared = make_worker, shared
        try:
            built = build(make_worker, shared, self._max_start_seconds)
        except (ImportError, InputError) as error:
            return Unfit(str(error) or type(error).__name__)
        except (OSError, MemoryError) as error:
            if not is_fault_of_machine(error):
                raise
            return Unfit(f"{type(error).__name__}: {error}")
        if isinstance(built, Unfit):
            return built
        self._worker = built
        return getattr(built, "wait", None) is not None

    def wait(self) -> None:
        """Wait for what the worker itself waits for, such as CPUs for its planners; that is no task's time.

        Raises:
            InputError: it will never come.
        """
        self._worker.wait()  # type: ignore[union-attr]

    def call(self, task: Any) -> Any:
        """The worker's result for `task`."""
        assert self._worker is not None
        return attempt(self._worker, task)

    def call_alone(self, task: Any, seconds: float | None) -> Any:
        """The same from a worker in a child process, whose death is explained (see `OwnProcess`).

        A task that takes longer than `seconds`, without the start of the process, gives a `TimedOut`.
        """
        process = OwnProcess(self._make_worker, self._shared, self._max_start_seconds)
        try:
            return process(task, seconds)
        except OutOfTime:
            assert seconds is not None
            return timed_out(seconds, socket.gethostname(), os.getpid())
        finally:
            process.close()
