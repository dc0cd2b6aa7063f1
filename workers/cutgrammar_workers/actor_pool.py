"""A pool of Ray actors that work through tasks and are replaced when they die.

Each actor has at most two tasks in flight, so a queue never grows with the number of tasks. When an actor dies, its
tasks become suspects: each is tried again as the only task of a new actor. A task that was not the cause then succeeds,
and one that kills three new actors is given up as `Crashed`.

An actor whose task exceeds its time limit, because it never ends or because its process or its node is stopped, is
killed and replaced. The task becomes a suspect and is given up as `TimedOut` when it exceeds the limit again; a task
that only waited behind it is handed out again.
"""

import contextlib
import os
import signal
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import ActorDiedError, NodeDiedError, OutOfMemoryError, RayError, RayTaskError

from cutgrammar.errors import InputError
from cutgrammar_workers.joining import first_line
from cutgrammar_workers.ray_session import cores, session
from cutgrammar_workers.tasks import (
    MAX_FAULTS,
    MAX_OVERTIMES,
    Crashed,
    Tasks,
    Worker,
    WorkerFactory,
    attempt,
    timed_out,
)

MAX_IN_FLIGHT = 2
"""Tasks handed to an actor at once: one in work, one waiting."""
MAX_DEATHS = 3
"""A task that has killed so many new actors as their only task is given up."""
CHECK_SECONDS = 10.0
"""Time limits are checked, and that workers start, after so long without a result [s]."""
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""There is one process a CPU; more threads would compete, and change the order of sums."""


def run_on_actors(
    make_worker: WorkerFactory,
    shared: Any,
    tasks: Tasks,
    on_result: Callable[[int, Any], None],
    workers: int | None,
    address: str | None,
    planners: int,
    py_modules: Sequence[Path],
    max_seconds: float | None = None,
) -> None:
    """See `pool.run_all`."""
    with session(workers, address, py_modules):
        cpus = cores()
        workers = cpus if workers is None else workers
        # Workers with planners claim no CPU: they only wait for their planners, which otherwise might never start.
        size = min(workers if planners == 1 else max(1, min(workers, cpus) // planners), len(tasks))
        pool = ActorPool(make_worker, ray.put(shared), size, 1.0 if planners == 1 else 0.0, max_seconds)
        try:
            pool.run(tasks, on_result)
        finally:
            pool.close()


class WorkerActor:
    """The class of the Ray actors: it builds a worker and calls it."""

    def __init__(self, make_worker: WorkerFactory, shared: Any) -> None:
        self._make_worker, self._shared = make_worker, shared
        self._worker: Worker | None = None

    def start(self) -> tuple[str, int]:
        """Build the worker; an exception here would recur for every task, so it ends the run.

        Returns:
            Ray's id of the node, and the process id.
        """
        self._worker = self._make_worker(self._shared)
        return ray.get_runtime_context().get_node_id(), os.getpid()

    def call(self, task: Any) -> Any:
        """The worker's result for `task`."""
        assert self._worker is not None
        return attempt(self._worker, task)


@dataclass(eq=False)
class PooledActor:
    """An actor of the pool.

    Attributes:
        handle: Ray's handle of the `WorkerActor`.
        starting: pending while the actor waits for a CPU or builds its worker, then None.
        tasks: pending result -> index of the task.
        is_new: it has not been given a task yet.
        has_suspect: its only task is a suspect.
        place: its node and process id, once it has started.
        since: when its first task of now came to be the first [s], by `time.monotonic`.
    """

    handle: Any
    starting: Any
    tasks: dict[Any, int] = field(default_factory=dict)
    is_new: bool = True
    has_suspect: bool = False
    place: tuple[str, int] | None = None
    since: float = 0.0


@dataclass(eq=False)
class TaskQueue:
    """The tasks of one run that are still to be handed out.

    Attributes:
        tasks: all tasks.
        waiting: indices of those not handed out yet.
        suspects: indices of those that were in flight on an actor that died.
        deaths: index -> number of new actors that died with it as their only task.
        faults: index -> number of faults of the machine that it met as the only task of its actor, or raised.
        overtimes: index -> number of times that it exceeded its time limit.
    """

    tasks: Tasks
    waiting: deque[int]
    suspects: deque[int] = field(default_factory=deque)
    deaths: Counter[int] = field(default_factory=Counter)
    faults: Counter[int] = field(default_factory=Counter)
    overtimes: Counter[int] = field(default_factory=Counter)


class ActorPool:
    """A number of equal actors that work through tasks, run after run, until the pool is closed.

    Args:
        make_worker: see `pool.run_all`.
        shared: reference to the Ray object that the workers are made from.
        size: number of actors.
        cpus: CPUs that each of them claims.
        max_seconds: time limit of a task [s]; None for none.
    """

    def __init__(
        self, make_worker: WorkerFactory, shared: Any, size: int, cpus: float, max_seconds: float | None = None
    ) -> None:
        self._max_seconds = max_seconds
        remote = ray.remote(WorkerActor).options(num_cpus=cpus, runtime_env={"env_vars": ONE_THREAD})
        self._new_handle: Callable[[], Any] = lambda: remote.remote(make_worker, shared)
        self._failed_starts = 0
        self._created = time.monotonic()
        self._waiting_reported = False
        self._actors: list[PooledActor] = []
        for _ in range(size):
            self._add_actor()

    def run(self, tasks: Tasks, on_result: Callable[[int, Any], None]) -> None:
        """Carry out all tasks (see `pool.run_all`)."""
        for actor in [actor for actor in self._actors if actor.tasks]:  # tasks of an earlier run that was interrupted
            self._replace(actor)
        queue = TaskQueue(tasks, deque(range(len(tasks))))
        n_left = len(tasks)
        while n_left:
            self._assign(queue)
            finished = self._wait(queue)
            if finished is not None:
                n_left -= 1
                on_result(*finished)

    def close(self) -> None:
        """End the actors."""
        for actor in self._actors:
            ray.kill(actor.handle)
        self._actors = []

    def _add_actor(self) -> None:
        handle = self._new_handle()
        self._actors.append(PooledActor(handle, handle.start.remote()))

    def _replace(self, actor: PooledActor) -> None:
        ray.kill(actor.handle)
        if actor.place is not None and actor.place[0] == ray.get_runtime_context().get_node_id():
            with contextlib.suppress(ProcessLookupError):  # a stopped process does not obey Ray
                os.kill(actor.place[1], signal.SIGKILL)
        self._actors.remove(actor)
        self._add_actor()

    def _assign(self, queue: TaskQueue) -> None:
        """Hand each suspect to a new actor, and other tasks to any; second tasks only while there is one for each."""
        for depth in range(MAX_IN_FLIGHT):
            for actor in self._actors:
                if actor.starting is not None or actor.has_suspect or len(actor.tasks) != depth:
                    continue
                if queue.suspects and actor.is_new:
                    actor.has_suspect = True
                    self._submit(actor, queue.tasks, queue.suspects.popleft())
                elif queue.waiting and (depth == 0 or len(queue.waiting) >= len(self._actors)):
                    self._submit(actor, queue.tasks, queue.waiting.popleft())
        idle = [actor for actor in self._actors if not (actor.is_new or actor.tasks)]
        for actor in idle[: len(queue.suspects)]:  # frees its CPU for the new actor of a suspect
            self._replace(actor)

    def _submit(self, actor: PooledActor, tasks: Tasks, index: int) -> None:
        actor.is_new = False
        if not actor.tasks:
            actor.since = time.monotonic()
        actor.tasks[actor.handle.call.remote(tasks[index])] = index

    def _wait(self, queue: TaskQueue) -> tuple[int, Any] | None:
        """Wait for the next event: (index, result) of a task, or None where an actor has started or died."""
        owners = {actor.starting: actor for actor in self._actors if actor.starting is not None}
        owners |= {pending: actor for actor in self._actors for pending in actor.tasks}
        ready, _ = ray.wait(list(owners), num_returns=1, timeout=self._patience())
        if not ready:
            late = self._late_actor()
            if late is not None:
                return self._handle_overtime(late, queue)
            self._report_waiting()
            return None
        actor = owners[ready[0]]
        try:
            result = ray.get(ready[0])
        except RayTaskError as error:
            if isinstance(error.cause, ImportError):
                raise InputError(
                    f"a worker's node lacks what it needs: {first_line(error.cause)}; install it on every node, or "
                    "send it with --py-module"
                ) from error
            raise error.cause from None
        except RayError as error:
            return self._handle_death(actor, queue, error)
        if ready[0] == actor.starting:
            actor.starting, actor.place = None, result
            self._failed_starts = 0
            return None
        if isinstance(result, Crashed) and result.by_machine:
            return self._handle_fault(actor, queue, actor.tasks.pop(ready[0]), result)
        actor.has_suspect = False
        actor.since = time.monotonic()
        return actor.tasks.pop(ready[0]), result

    def _handle_fault(
        self, actor: PooledActor, queue: TaskQueue, index: int, result: Crashed
    ) -> tuple[int, Any] | None:
        """Try a task again that met a fault of the machine, on a new actor; give it up after `MAX_FAULTS`."""
        queue.waiting.extendleft(reversed(actor.tasks.values()))
        self._replace(actor)
        queue.faults[index] += 1
        if queue.faults[index] == MAX_FAULTS:
            return index, result
        queue.suspects.append(index)
        return None

    def _patience(self) -> float:
        """How long to wait for a result before the time limits are checked [s]."""
        if self._max_seconds is None:
            return CHECK_SECONDS
        ends = [actor.since + self._max_seconds for actor in self._actors if actor.tasks]
        return min([CHECK_SECONDS, *(max(0.0, end - time.monotonic()) for end in ends)])

    def _late_actor(self) -> PooledActor | None:
        """An actor whose first task has exceeded its time limit."""
        if self._max_seconds is None:
            return None
        latest = time.monotonic() - self._max_seconds
        return next((actor for actor in self._actors if actor.tasks and actor.since <= latest), None)

    def _handle_overtime(self, actor: PooledActor, queue: TaskQueue) -> tuple[int, Any] | None:
        """Replace an actor whose first task takes too long; (index, `TimedOut`) if the task is given up."""
        assert self._max_seconds is not None
        late, *behind = actor.tasks.values()
        self._replace(actor)
        queue.waiting.extendleft(reversed(behind))
        queue.overtimes[late] += 1
        if queue.overtimes[late] == MAX_OVERTIMES:
            return late, timed_out(self._max_seconds)
        queue.suspects.append(late)
        return None

    def _report_waiting(self) -> None:
        """Report once that no worker has a CPU yet."""
        started = any(actor.starting is None for actor in self._actors)
        is_late = time.monotonic() - self._created > 2 * CHECK_SECONDS
        if is_late and not (started or self._waiting_reported):
            self._waiting_reported = True
            cpus, free = (resources().get("CPU", 0) for resources in (ray.cluster_resources, ray.available_resources))
            print(f"no worker has started yet: Ray has {cpus:g} CPUs, {free:g} of them free", file=sys.stderr)

    def _handle_death(self, actor: PooledActor, queue: TaskQueue, error: RayError) -> tuple[int, Any] | None:
        """Replace an actor that died and make its tasks suspects; (index, `Crashed`) for a task that is given up."""
        if actor.starting is not None:
            self._failed_starts += 1
            if self._failed_starts > 3 * len(self._actors):
                raise InputError(
                    f"workers keep dying while they start: {first_line(error)}; see whether --workers 0 works"
                ) from error
        self._replace(actor)
        lost = list(actor.tasks.values())
        if actor.has_suspect:
            where = f" (process {actor.place[1]} on node {actor.place[0]})" if actor.place else ""
            by_machine = _is_death_by_machine(error)
            counts, limit = (queue.faults, MAX_FAULTS) if by_machine else (queue.deaths, MAX_DEATHS)
            counts[lost[0]] += 1
            if counts[lost[0]] == limit:
                reason = f"its process died {limit} times: {first_line(error)}{where}"
                return lost[0], Crashed(reason, "", by_machine)
        queue.suspects.extend(lost)
        return None


def _is_death_by_machine(error: RayError) -> bool:
    """Whether an actor died with its node, by preemption, or because Ray's monitor found the memory full."""
    if isinstance(error, OutOfMemoryError | NodeDiedError):
        return True
    return isinstance(error, ActorDiedError) and (error.preempted or "its node has died" in str(error))
