"""The class of the Ray actors of a pool: it builds a worker and calls it."""

import os
import signal
import socket
from dataclasses import dataclass
from typing import Any

import ray

from cutgrammar.errors import InputError
from cutgrammar_workers.own_process import OwnProcess
from cutgrammar_workers.tasks import Worker, WorkerFactory, attempt, is_fault_of_machine, timed_out
from cutgrammar_workers.time_limit import OutOfTime


@dataclass(frozen=True)
class Place:
    """Where an actor runs.

    Attributes:
        node: Ray's id of the node.
        host: name of its machine.
        pid: process id.
        unfit: why no worker can be built there; None if one was.
    """

    node: str
    host: str
    pid: int
    unfit: str | None = None


class WorkerActor:
    """Carries out tasks, in its own process or in a child."""

    def __init__(self, make_worker: WorkerFactory, shared: Any) -> None:
        # Ray's handler raises SystemExit wherever the process is, which looks as if the method had left by it.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        self._make_worker, self._shared = make_worker, shared
        self._worker: Worker | None = None

    def start(self) -> Place:
        """Build the worker.

        An exception that says nothing of this node would recur for every task, so it ends the run.
        """
        unfit = None
        try:
            self._worker = self._make_worker(self._shared)
        except (ImportError, InputError) as error:
            unfit = str(error) or type(error).__name__
        except (OSError, MemoryError) as error:
            if not is_fault_of_machine(error):
                raise
            unfit = f"{type(error).__name__}: {error}"
        return Place(ray.get_runtime_context().get_node_id(), socket.gethostname(), os.getpid(), unfit)

    def call(self, task: Any) -> Any:
        """The worker's result for `task`."""
        assert self._worker is not None
        return attempt(self._worker, task)

    def call_alone(self, task: Any, seconds: float | None) -> Any:
        """The same from a worker in a child process, whose death is explained (see `OwnProcess`).

        A task that takes longer than `seconds`, without the start of the process, gives a `TimedOut`.
        """
        process = OwnProcess(self._make_worker, self._shared)
        try:
            return process(task, seconds)
        except OutOfTime:
            assert seconds is not None
            return timed_out(seconds, socket.gethostname(), os.getpid())
        finally:
            process.close()
