"""The pool on Ray: actors that are thin shells over plain workers, and a bounded pump that outlives their deaths.

Each actor has at most two tasks in flight, so a queue never grows with the number of tasks. When an actor dies, its
tasks become suspects: each is tried again alone on a fresh actor, which clears those that merely stood by, and one that
dies so three times is given up as `Crashed`.
"""

import contextlib
import importlib.util
import logging
import os
import socket
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import ray
from ray.exceptions import RayError, RayTaskError

from cutgrammar.errors import InputError
from cutgrammar_workers.tasks import Crashed, Tasks, attempt

IN_FLIGHT = 2
"""Tasks handed to an actor at once: one at work, one waiting."""
LONE_DEATHS = 3
"""A task that killed so many fresh actors on which it was alone is given up."""
LOOK_SECONDS = 10.0
"""How often to look after the cluster while nothing comes back [s]."""
SILENT_SECONDS = 60.0
"""A cluster whose head has not answered for so long is given up [s]; a head that is only restarted answers before."""
PACKAGES = ("cutgrammar", "cutgrammar_sim", "cutgrammar_workers", "cutgrammar_pipelines", "cutgrammar_dashboards")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""One process a CPU: threads inside would fight, and change the order of sums."""


def run_all(
    worker: Callable[[Any], Callable[[Any], Any]],
    shared: Any,
    tasks: Tasks,
    on_result: Callable[[int, Any], None],
    workers: int,
    address: str | None,
    planners: int,
    py_modules: Sequence[str],
) -> None:
    """See `pool.run_all`."""
    with session(workers, address, py_modules):
        cpus = int(ray.cluster_resources().get("CPU", 0))
        # With planners of their own, workers wait for these and claim no CPU; one without any would wait for ever.
        size = min(workers if planners == 1 else max(1, min(workers, cpus) // planners), len(tasks))
        crew = Crew(worker, ray.put(shared), size, cpus=1.0 if planners == 1 else 0.0)
        try:
            crew.run(tasks, on_result)
        finally:
            crew.close()


@contextlib.contextmanager
def session(workers: int, address: str | None = None, py_modules: Sequence[str] = ()) -> Iterator[None]:
    """Ray for the length of a `with` block; what already runs in this process is used and left running.

    Raises:
        InputError: there is no cluster at `address`.
    """
    if ray.is_initialized():
        yield
        return
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
    if address is None:
        ray.init(address="local", num_cpus=workers, include_dashboard=False, **quiet)
    else:
        _knock(address)
        try:
            ray.init(address=address, runtime_env={"py_modules": [*_package_folders(), *py_modules]}, **quiet)
        except ConnectionError as error:
            raise _nobody(address, error) from error
        except RuntimeError as error:  # another version of Ray or Python
            raise InputError(f"the Ray cluster at {address!r} cannot be joined: {_first_line(error)}") from error
    try:
        yield
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Find out in seconds whether anybody listens at HOST:PORT; Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # "auto" and other names that Ray looks up by itself
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except OSError as error:
        raise _nobody(address, error) from error


def _answers(address: str) -> bool:
    """Whether anybody listens at HOST:PORT."""
    try:
        _knock(address)
    except InputError:
        return False
    return True


def _nobody(address: str, error: Exception) -> InputError:
    return InputError(f"no Ray cluster answers at {address!r} ({_first_line(error)}); start one or leave --address out")


def _package_folders() -> list[str]:
    """Where the code lies that a cluster's nodes need: one folder a package."""
    specs = [importlib.util.find_spec(name) for name in PACKAGES]
    return [str(folder) for spec in specs if spec is not None for folder in spec.submodule_search_locations or ()]


class Shell:
    """What Ray sees of a worker."""

    def __init__(self, worker: Callable[[Any], Callable[[Any], Any]], shared: Any) -> None:
        self._make: Callable[[], Callable[[Any], Any]] = lambda: worker(shared)
        self._worker: Callable[[Any], Any] | None = None

    def start(self) -> None:
        """Build the worker; what goes wrong here would go wrong for every task and stops the run."""
        self._worker = self._make()

    def call(self, task: Any) -> Any:
        """The worker's result for `task`."""
        assert self._worker is not None
        return attempt(self._worker, task)


@dataclass(eq=False)
class Member:
    """An actor of the crew.

    Attributes:
        actor: handle of the `Shell`.
        starting: pending while the actor waits for a CPU or builds its worker; no task is handed to it meanwhile.
        tasks: pending result -> index of the task.
        fresh: it has not been given a task yet.
        alone: its task is a suspect and has the actor for itself.
    """

    actor: Any
    starting: Any
    tasks: dict[Any, int] = field(default_factory=dict)
    fresh: bool = True
    alone: bool = False


@dataclass(eq=False)
class Work:
    """What is still to be handed out of one run.

    Attributes:
        tasks: all tasks.
        waiting: indices of those not handed out yet.
        suspects: indices of those that were in flight on an actor that died.
        lone_deaths: index -> how often a fresh actor died of it.
    """

    tasks: Tasks
    waiting: deque[int]
    suspects: deque[int] = field(default_factory=deque)
    lone_deaths: Counter[int] = field(default_factory=Counter)


class Crew:
    """A number of like actors that work off tasks, run after run, until it is closed."""

    def __init__(self, worker: Callable[[Any], Callable[[Any], Any]], shared: Any, size: int, cpus: float) -> None:
        """Start the actors.

        Args:
            worker: see `pool.run_all`.
            shared: reference to the Ray object that the workers are built from.
            size: number of actors.
            cpus: that each of them claims.
        """
        shell = ray.remote(Shell).options(num_cpus=cpus, runtime_env={"env_vars": ONE_THREAD})
        self._new: Callable[[], Any] = lambda: shell.remote(worker, shared)
        self._failed_starts = 0
        self._began = self._answered = time.monotonic()
        self._told_of_waiting = False
        self._members: list[Member] = []
        for _ in range(size):
            self._join()

    def run(self, tasks: Tasks, on_result: Callable[[int, Any], None]) -> None:
        """See `pool.run_all`."""
        for member in [member for member in self._members if member.tasks]:  # left over from a run that was broken off
            self._replace(member)
        work = Work(tasks, deque(range(len(tasks))))
        left = len(tasks)
        while left:
            self._hand_out(work)
            finished = self._next(work)
            if finished is not None:
                left -= 1
                on_result(*finished)

    def close(self) -> None:
        """End the actors."""
        for member in self._members:
            ray.kill(member.actor)
        self._members = []

    def _join(self) -> None:
        actor = self._new()
        self._members.append(Member(actor, actor.start.remote()))

    def _replace(self, member: Member) -> None:
        ray.kill(member.actor)
        self._members.remove(member)
        self._join()

    def _hand_out(self, work: Work) -> None:
        """Suspects alone to fresh actors; the rest to any, a second one only while there is one for everybody."""
        for depth in range(IN_FLIGHT):
            for member in self._members:
                if member.starting is not None or member.alone or len(member.tasks) != depth:
                    continue
                if work.suspects and member.fresh:
                    member.alone = True
                    self._give(member, work.tasks, work.suspects.popleft())
                elif work.waiting and (depth == 0 or len(work.waiting) >= len(self._members)):
                    self._give(member, work.tasks, work.waiting.popleft())
        idle = [member for member in self._members if not (member.fresh or member.tasks)]
        for member in idle[: len(work.suspects)]:  # its CPU goes to a fresh one, which may be waiting for it
            self._replace(member)

    def _give(self, member: Member, tasks: Tasks, index: int) -> None:
        member.fresh = False
        member.tasks[member.actor.call.remote(tasks[index])] = index

    def _next(self, work: Work) -> tuple[int, Any] | None:
        """Wait for whatever comes next: (index, result) of a task, or None for news of the actors."""
        owners = {member.starting: member for member in self._members if member.starting is not None}
        owners |= {pending: member for member in self._members for pending in member.tasks}
        ready, _ = ray.wait(list(owners), num_returns=1, timeout=LOOK_SECONDS)
        if not ready:
            self._look_after_cluster()
            return None
        member = owners[ready[0]]
        try:
            result = ray.get(ready[0])
        except RayTaskError as error:
            if isinstance(error.cause, ImportError):
                raise InputError(
                    f"a worker's node lacks what it needs: {_first_line(error.cause)}; install it on every node"
                ) from error
            raise error.cause from None
        except RayError as error:
            return self._bury(member, work, error)
        if ready[0] == member.starting:
            member.starting = None
            self._failed_starts = 0
            return None
        member.alone = False
        return member.tasks.pop(ready[0]), result

    def _look_after_cluster(self) -> None:
        """Say once that workers wait for their CPUs, and give up a cluster whose head is gone; Ray would wait for ever.

        Raises:
            ConnectionError: the head has not answered for `SILENT_SECONDS`.
        """
        now = time.monotonic()
        head = ray.get_runtime_context().gcs_address
        if _answers(head):
            self._answered = now
        elif now - self._answered > SILENT_SECONDS:
            raise ConnectionError(f"the Ray cluster at {head} has not answered for {now - self._answered:.0f} s")
        started = any(member.starting is None for member in self._members)
        if not (started or self._told_of_waiting) and self._answered == now and now - self._began > 2 * LOOK_SECONDS:
            self._told_of_waiting = True
            cpus, free = (resources().get("CPU", 0) for resources in (ray.cluster_resources, ray.available_resources))
            print(f"no worker has started yet: Ray has {cpus:g} CPUs, {free:g} of them free", file=sys.stderr)

    def _bury(self, member: Member, work: Work, error: RayError) -> tuple[int, Any] | None:
        """Replace an actor that died; its tasks are suspects, and one that died alone too often is given up."""
        if member.starting is not None:
            self._failed_starts += 1
            if self._failed_starts > 3 * len(self._members):
                raise InputError(
                    f"workers keep dying while they start: {_first_line(error)}; see whether --workers 0 works"
                ) from error
        self._replace(member)
        lost = list(member.tasks.values())
        if member.alone:
            work.lone_deaths[lost[0]] += 1
            if work.lone_deaths[lost[0]] == LONE_DEATHS:
                return lost[0], Crashed(f"its process died {LONE_DEATHS} times: {_first_line(error)}", "")
        work.suspects.extend(lost)
        return None


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
