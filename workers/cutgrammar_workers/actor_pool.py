"""A pool of Ray actors that work through tasks and are replaced when they die.

Each actor has at most two tasks in flight, so a queue never grows with the number of tasks. When an actor dies, its
tasks become suspects: each is tried again as the only task of an actor, in a child process of it, which shows how the
process ends (see `own_process`). A task that was not the cause then succeeds, one that ends its process by its own
doing is given up as `Crashed` after `MAX_DEATHS`, and faults of the machine are repeated up to the failure budget.

An actor whose task exceeds its time limit, because it never ends or because its process or its node is stopped, is
killed and replaced. The task becomes a suspect and is given up as `TimedOut` when it exceeds the limit again; a task
that only waited behind it is handed out again.

An actor starts in steps: it says where it is, builds its worker, and lets that wait if it must. Only building has a
time limit, since before and after it may wait for a free CPU or a new node. The actor keeps the limit itself, and so
can say where it hung; one that cannot is stopped a little later.
"""

import contextlib
import math
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError, RaySystemError, RayTaskError

from cutgrammar.errors import InputError
from cutgrammar_workers.joining import first_line
from cutgrammar_workers.nodes import HANG, Nodes, is_death_by_machine, place_of
from cutgrammar_workers.one_thread import ONE_THREAD
from cutgrammar_workers.pool_state import PooledActor, TaskQueue
from cutgrammar_workers.ray_session import cores, session
from cutgrammar_workers.tasks import (
    MAX_FAULTS,
    START_SECONDS,
    Crashed,
    OnFault,
    Tasks,
    TimedOut,
    Unfit,
    WorkerFactory,
    nowhere,
    timed_out,
    too_slow,
    what_hangs,
)
from cutgrammar_workers.worker_actor import Place, WorkerActor

MAX_IN_FLIGHT = 2
"""Tasks handed to an actor at once: one in work, one waiting."""
CHECK_SECONDS = 10.0
"""Time limits are checked, and that workers start, after so long without a result [s]."""
CHILD_SECONDS = 120.0
"""How much later than its child an actor with a suspect is given up, should it hang itself [s]."""
BUILD_SECONDS = 10.0
"""How much later than its own time limit an actor that builds its worker is given up [s]."""


def run_on_actors(
    make_worker: WorkerFactory,
    shared: Any,
    tasks: Tasks,
    on_result: Callable[[int, Any], None],
    workers: int | None,
    address: str | None,
    planners: int,
    py_modules: Sequence[Path],
    max_seconds: float | None,
    max_faults: int,
    on_fault: OnFault,
    on_pause: Callable[[], None],
    max_start_seconds: float,
) -> None:
    """See `pool.run_all`."""
    with session(workers, address, py_modules):
        cpus = cores()
        workers = cpus if workers is None else workers
        # Workers with planners claim no CPU: they only wait for their planners, which otherwise might never start.
        size = min(workers if planners == 1 else max(1, min(workers, cpus) // planners), len(tasks))
        cpus_each = 1.0 if planners == 1 else 0.0
        reference = ray.put(shared)
        pool = ActorPool(make_worker, reference, size, cpus_each, max_seconds, max_faults, True, max_start_seconds)
        try:
            pool.run(tasks, on_result, on_fault, on_pause)
        finally:
            pool.close()


class ActorPool:
    """A number of equal actors that work through tasks, run after run, until the pool is closed.

    Args:
        make_worker: see `pool.run_all`.
        shared: reference to the Ray object that the workers are made from.
        size: number of actors.
        cpus: CPUs that each of them claims.
        max_seconds: time limit of a task [s]; None for none.
        max_faults: the failure budget of a task.
        has_children: suspects are carried out in child processes. Tasks that need Ray cannot; they are given up, as
            `Crashed`, when `MAX_DEATHS` actors have died with them alone.
        max_start_seconds: time limit for building a worker [s].
    """

    def __init__(
        self,
        make_worker: WorkerFactory,
        shared: Any,
        size: int,
        cpus: float,
        max_seconds: float | None = None,
        max_faults: int = MAX_FAULTS,
        has_children: bool = True,
        max_start_seconds: float = START_SECONDS,
    ) -> None:
        self._max_seconds, self._max_faults, self._has_children = max_seconds, max_faults, has_children
        self._max_start_seconds, self._worker = max_start_seconds, (make_worker, shared)
        self._nodes = Nodes()
        actor, options = ray.remote(WorkerActor), {"num_cpus": cpus, "runtime_env": {"env_vars": ONE_THREAD}}
        self._new_handle: Callable[[], Any] = lambda: actor.options(
            **options, label_selector=self._nodes.selector
        ).remote(max_start_seconds)
        self._failed_starts = 0
        self._created = time.monotonic()
        self._waiting_reported = False
        self._actors: list[PooledActor] = []
        self._owners: dict[Any, PooledActor] = {}  # of all that is pending
        self._ready: deque[Any] = deque()  # what is no longer pending, but for what was of actors that died since
        for _ in range(size):
            self._add_actor()

    def run(
        self,
        tasks: Tasks,
        on_result: Callable[[int, Any], None],
        on_fault: OnFault,
        on_pause: Callable[[], None] = nowhere,
    ) -> None:
        """Carry out all tasks (see `pool.run_all`)."""
        for actor in [actor for actor in self._actors if actor.tasks]:  # tasks of an earlier run that was interrupted
            self._replace(actor)
        queue = TaskQueue(tasks, deque(range(len(tasks))), on_fault, self._max_faults)
        n_left = len(tasks)
        while n_left:
            if not self._ready:
                self._assign(queue)
                on_pause()
            finished = self._wait(queue)
            if finished is not None:
                n_left -= 1
                on_result(*finished)

    def wait(self) -> None:
        """Wait until an actor has started.

        Raises:
            InputError: no worker can be built.
        """
        queue = TaskQueue((), deque(), nowhere, self._max_faults)
        while all(actor.starting is not None for actor in self._actors):
            self._wait(queue)

    def close(self) -> None:
        """End the actors."""
        for actor in self._actors:
            _kill(actor)
        self._actors = []

    def _add_actor(self) -> None:
        handle = self._new_handle()
        actor = PooledActor(handle, handle.place.remote())
        self._owners[actor.starting] = actor
        self._actors.append(actor)

    def _next_step(self, actor: PooledActor, pending: Any) -> None:
        actor.starting = pending
        self._owners[pending] = actor

    def _replace(self, actor: PooledActor) -> None:
        _kill(actor)
        self._actors.remove(actor)
        for pending in (actor.starting, *actor.tasks):
            self._owners.pop(pending, None)
        self._add_actor()

    def _assign(self, queue: TaskQueue) -> None:
        """Hand each suspect to an idle actor, and other tasks to any; second tasks only while there is one for each."""
        for depth in range(MAX_IN_FLIGHT):
            for actor in self._actors:
                if actor.starting is not None or actor.has_suspect or len(actor.tasks) != depth:
                    continue
                if queue.suspects and depth == 0:
                    actor.has_suspect = True
                    self._submit(actor, queue.tasks, queue.suspects.popleft())
                elif queue.waiting and (depth == 0 or len(queue.waiting) >= len(self._actors)):
                    self._submit(actor, queue.tasks, queue.waiting.popleft())

    def _submit(self, actor: PooledActor, tasks: Tasks, index: int) -> None:
        if not actor.tasks:
            actor.since = time.monotonic()
        if actor.has_suspect and self._has_children:
            pending = actor.handle.call_alone.remote(tasks[index], self._max_seconds)
        else:
            pending = actor.handle.call.remote(tasks[index])
        actor.tasks[pending] = index
        self._owners[pending] = actor

    def _wait(self, queue: TaskQueue) -> tuple[int, Any] | None:
        """Wait for the next event: (index, result) of a task, or None where an actor has begun, started or died."""
        if not self._ready:
            pending = list(self._owners)
            first, _ = ray.wait(pending, num_returns=1, timeout=self._patience())
            # All that is there is taken at once: waiting takes longer the more is pending.
            self._ready.extend(first and ray.wait(pending, num_returns=len(pending), timeout=0)[0])
        if not self._ready:
            late = self._late_actor()
            if late is not None and late.is_building:
                self._handle_hang(late, too_slow(self._max_start_seconds))
                return None
            if late is not None:
                return self._handle_overtime(late, queue)
            self._report_waiting()
            return None
        ready = self._ready.popleft()
        actor = self._owners.pop(ready, None)
        if actor is None:
            return None
        try:
            result = ray.get(ready)
        except RayTaskError as error:
            if isinstance(error.cause, RaySystemError) and ready == actor.starting:  # the factory cannot be unpickled
                return self._handle_death(actor, queue, error.cause)
            if isinstance(error.cause, ImportError):
                raise InputError(_lacking(first_line(error.cause))) from error
            raise error.cause from None
        except RayError as error:
            return self._handle_death(actor, queue, error)
        if ready == actor.starting:
            self._handle_start(actor, queue, result)
            return None
        index = actor.tasks.pop(ready)
        has_failed = isinstance(result, Crashed) and result.by_machine
        if has_failed and not result.died:  # memory or a disk was full: the actor may be the worse for it
            self._take_back(actor, queue)
            self._replace(actor)
            if actor.place is not None and self._nodes.strike(actor.place, result.reason):
                self._abandon(actor.place.node, queue)
        actor.has_suspect = False
        actor.since = time.monotonic()
        if has_failed:
            return queue.repeat_after_fault(index, result)
        if isinstance(result, Crashed) and result.died:
            return queue.repeat_after_death(index, result)
        if isinstance(result, TimedOut):
            return queue.repeat_after_overtime(index, result)
        if actor.place is not None:
            self._nodes.clear(actor.place)
        return index, result

    def _handle_start(self, actor: PooledActor, queue: TaskQueue, answer: Place | Unfit | bool | None) -> None:
        """An actor has made a step of its start, or its node lacks what a worker needs.

        Raises:
            InputError: no node has what a worker needs, or workers hang on all of them.
        """
        if isinstance(answer, Place):
            actor.place, actor.is_building, actor.since = answer, True, time.monotonic()
            self._next_step(actor, actor.handle.build.remote(*self._worker))
            return
        assert actor.place is not None
        if isinstance(answer, Unfit) and answer.hangs:
            self._handle_hang(actor, answer.reason)
        elif isinstance(answer, Unfit):
            if not self._nodes.set_aside(actor.place, answer.reason):
                raise InputError(answer.reason if "--py-module" in answer.reason else _lacking(answer.reason))
            self._abandon(actor.place.node, queue)
        elif answer:
            actor.is_building = False
            self._next_step(actor, actor.handle.wait.remote())
        else:
            actor.starting, actor.is_building = None, False
            self._failed_starts = 0

    def _handle_hang(self, actor: PooledActor, reason: str) -> None:
        """Replace an actor that hangs while it builds its worker.

        Raises:
            InputError: no actor has started, and workers hang on all nodes.
        """
        place = actor.place
        assert place is not None
        if not self._nodes.is_cut_off(place) and not self._nodes.strike(place, reason, HANG):
            works = any(other.starting is None for other in self._actors)
            if self._nodes.is_struck(place) and not works:
                raise InputError(what_hangs(f"{reason} (process {place.pid} on {place.host})"))
        self._replace(actor)

    def _abandon(self, node: str, queue: TaskQueue) -> None:
        """Replace all actors on a node that is set aside."""
        for actor in [actor for actor in self._actors if actor.place is not None and actor.place.node == node]:
            self._take_back(actor, queue)
            self._replace(actor)

    def _take_back(self, actor: PooledActor, queue: TaskQueue) -> None:
        """Hand out the tasks of an actor again."""
        (queue.suspects if actor.has_suspect else queue.waiting).extendleft(reversed(actor.tasks.values()))
        for pending in actor.tasks:
            self._owners.pop(pending, None)
        actor.tasks = {}

    def _patience(self) -> float:
        """How long to wait for a result before the time limits are checked [s]."""
        ends = [self._deadline(actor) - time.monotonic() for actor in self._actors]
        return min([CHECK_SECONDS, *(max(0.0, end) for end in ends)])

    def _deadline(self, actor: PooledActor) -> float:
        """When what an actor does has exceeded its time limit, by `time.monotonic` [s].

        An actor that builds its worker has the limit for that. A suspect's child keeps both limits itself.
        """
        if actor.is_building:
            return actor.since + self._max_start_seconds + BUILD_SECONDS
        if self._max_seconds is None or not actor.tasks:
            return math.inf
        own = actor.has_suspect and self._has_children
        return actor.since + self._max_seconds + (self._max_start_seconds + CHILD_SECONDS) * own

    def _late_actor(self) -> PooledActor | None:
        """An actor that has exceeded its time limit."""
        return next((actor for actor in self._actors if self._deadline(actor) <= time.monotonic()), None)

    def _handle_overtime(self, actor: PooledActor, queue: TaskQueue) -> tuple[int, Any] | None:
        """Replace an actor whose first task takes too long; (index, result) if the task is given up.

        It is a fault of the machine if the node does not answer, or the actor does not whose child has its own limit.
        """
        assert self._max_seconds is not None
        late, *behind = actor.tasks.values()
        is_cut_off = actor.place is not None and self._nodes.is_cut_off(actor.place)
        self._replace(actor)
        queue.waiting.extendleft(reversed(behind))
        if is_cut_off or (actor.has_suspect and self._has_children):
            reason = "the node does not answer" if is_cut_off else "the worker does not answer"
            return queue.repeat_after_fault(late, Crashed(reason, "", True, True, *actor.host_and_pid))
        return queue.repeat_after_overtime(late, timed_out(self._max_seconds, *actor.host_and_pid))

    def _report_waiting(self) -> None:
        """Report once that no worker has a CPU yet."""
        started = any(actor.starting is None or actor.is_building for actor in self._actors)
        is_late = time.monotonic() - self._created > 2 * CHECK_SECONDS
        if is_late and not (started or self._waiting_reported):
            self._waiting_reported = True
            cpus, free = (resources().get("CPU", 0) for resources in (ray.cluster_resources, ray.available_resources))
            print(f"no worker has started yet: Ray has {cpus:g} CPUs, {free:g} of them free", file=sys.stderr)

    def _handle_death(self, actor: PooledActor, queue: TaskQueue, error: RayError) -> tuple[int, Any] | None:
        """Replace an actor that died and make its tasks suspects; (index, `Crashed`) for a task that is given up."""
        place = actor.place or place_of(actor.handle)
        if not (place is not None and self._nodes.is_lost(place, error)) and actor.starting is not None:
            self._handle_failed_start(place, error)
        self._replace(actor)
        if not actor.has_suspect:
            queue.suspects.extend(actor.tasks.values())
            return None
        # An actor with a suspect only waits for its child, so that it died by its own doing only without one.
        by_machine = self._has_children or is_death_by_machine(error)
        where = f" (process {place.pid} on {place.host}, node {place.node})" if place else ""
        result = Crashed(f"{first_line(error)}{where}", "", by_machine, True, *actor.host_and_pid)
        (index,) = actor.tasks.values()
        return queue.repeat_after_fault(index, result) if by_machine else queue.repeat_after_death(index, result)

    def _handle_failed_start(self, place: Place | None, error: RayError) -> None:
        """An actor died before it had a worker.

        Raises:
            InputError: this happens again and again, and on all nodes.
        """
        self._failed_starts += 1
        if place is not None and self._nodes.strike(place, f"workers die while they start: {first_line(error)}"):
            self._failed_starts = 0
        if self._failed_starts > 3 * len(self._actors):
            raise InputError(
                f"workers keep dying while they start: {first_line(error)}; see whether --workers 0 works"
            ) from error


def _kill(actor: PooledActor) -> None:
    """End an actor, and its process where it is on this node: one that is stopped does not obey Ray for seconds."""
    ray.kill(actor.handle)
    if actor.place is not None and actor.place.node == ray.get_runtime_context().get_node_id():
        with contextlib.suppress(ProcessLookupError):
            os.kill(actor.place.pid, signal.SIGKILL)


def _lacking(what: str) -> str:
    return f"a worker's node lacks what it needs: {what}; install it on every node, or send it with --py-module"
