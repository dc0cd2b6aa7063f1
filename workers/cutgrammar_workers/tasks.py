"""The tasks of workers, and how a crash becomes a result."""

import errno
import os
import socket
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypedDict

from cutgrammar.errors import InputError
from cutgrammar_workers.time_limit import OutOfTime, time_limit

Worker = Callable[[Any], Any]
"""task -> result.

If it has a `wait` that is not None, an actor calls that once, before the first task: for what is no task's time.
"""

WorkerFactory = Callable[[Any], Worker]
"""Data that all tasks share -> worker; a class of an importable module."""


class Tasks(Protocol):
    """A sequence of tasks, or an object that makes them on demand."""

    def __len__(self) -> int:
        """Number of tasks."""
        ...

    def __getitem__(self, index: int, /) -> Any:
        """The task of that number, from 0."""
        ...


@dataclass(frozen=True)
class Crashed:
    """The result of a task whose worker raised an exception or died repeatedly.

    Attributes:
        reason: one line.
        traceback: where the exception was raised, or where the process was when it died, if that is known.
        by_machine: whether the machine was at fault and not the task: its memory or its disk was full, its node died,
            or its process was ended from outside.
        died: whether its process died.
        host, pid: of the process; None where they are not known.
    """

    reason: str
    traceback: str
    by_machine: bool = False
    died: bool = False
    host: str | None = None
    pid: int | None = None


MAX_FAULTS = 5
"""The usual failure budget: a task that has met so many faults of the machine is given up, and not scored."""
MAX_DEATHS = 3
"""A task that has ended so many processes by its own doing, in which it was alone, is given up."""


def is_fault_of_machine(error: BaseException) -> bool:
    """Whether memory or the disk was full."""
    return isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    )


@dataclass(frozen=True)
class TimedOut:
    """The result of a task that exceeded its time limit on each of `MAX_OVERTIMES` workers.

    Attributes:
        reason: one line.
        host, pid: of the last process that was stopped; None where they are not known.
    """

    reason: str
    host: str | None = None
    pid: int | None = None


MAX_TEXT = 10_000
"""Longer texts of exceptions and of methods are cut off."""


def printable(text: str) -> str:
    """A text that can be stored and printed: without lone surrogates, and at most `MAX_TEXT` characters of it."""
    short = text if len(text) <= MAX_TEXT else f"{text[:MAX_TEXT]} ..."
    return short.encode("utf-8", "backslashreplace").decode()


class _Place(TypedDict):
    host: str
    pid: int


def crash_of(error: BaseException) -> Crashed:
    """An exception as a result, to be called where it is handled."""
    place: _Place = {"host": socket.gethostname(), "pid": os.getpid()}
    try:
        reason = f"{type(error).__name__}: {error}"
        trace = traceback.format_exc()
    except Exception:  # noqa: BLE001  # the text of the exception raises one itself
        return Crashed(f"{type(error).__name__}, which has no text", "", **place)
    return Crashed(printable(reason), printable(trace[-MAX_TEXT:]), is_fault_of_machine(error), **place)


MAX_OVERTIMES = 2
"""A task that has exceeded its time limit so often is given up: it is tried once more, on a new worker."""


START_SECONDS = 900.0
"""The usual time limit for building a worker: importing plugins, fetching the data set [s]."""


@dataclass(frozen=True)
class Unfit:
    """Why a worker could not be built.

    Attributes:
        reason: one line.
        hangs: whether building it took longer than its time limit, which another attempt may not.
    """

    reason: str
    hangs: bool = False


def build(make_worker: WorkerFactory, shared: Any, seconds: float) -> Worker | Unfit:
    """`make_worker(shared)`, or that it took longer than `seconds`, as far as that can be interrupted in this process.

    For the limit see `time_limit`. Exceptions of the factory are not caught.
    """
    try:
        with time_limit(seconds):
            return make_worker(shared)
    except OutOfTime as error:
        last = traceback.extract_tb(error.__traceback__)[-2]  # the one behind it raised the exception
        return Unfit(f"{too_slow(seconds)}, and was at {printable(last.filename)}:{last.lineno}", hangs=True)


def too_slow(seconds: float) -> str:
    """What is said of a worker whose building exceeded a limit of `seconds`."""
    return f"a worker was not built within {seconds:g} s"


def what_hangs(reason: str) -> str:
    """What the user is told who has no worker for this reason."""
    return (
        f"{reason}; see what hangs there, such as a plugin's module or shared storage; `evaluate` gives more time by "
        "--max-start-seconds"
    )


def timed_out(seconds: float, host: str | None = None, pid: int | None = None) -> TimedOut:
    """The result of a task that exceeded a limit of `seconds`, the last time in this process."""
    return TimedOut(f"it was stopped after {seconds:g} s, {MAX_OVERTIMES} times (trial.max_seconds)", host, pid)


def gave_up(crashed: Crashed, times: int) -> Crashed:
    """The result of a task that has ended `times` processes."""
    return replace(crashed, reason=f"its process died {times} times: {crashed.reason}")


OnFault = Callable[[int, Crashed], None]
"""Told of an attempt that a fault of the machine ended, with the index of its task."""


def nowhere(*_: Any) -> None:
    """An `OnFault` that tells nobody."""


def settle(call: Callable[[], Any], seconds: float | None, max_faults: int, on_fault: Callable[[Crashed], None]) -> Any:
    """The result of `call`, repeated as long as it may be: a `Crashed` or `TimedOut` where the task is given up.

    Args:
        call: carries out the task; raises `OutOfTime` when that takes longer than `seconds`.
        seconds: the time limit.
        max_faults: the failure budget.
        on_fault: told of each fault of the machine.
    """
    faults = overtimes = deaths = 0
    while True:
        try:
            result = call()
        except OutOfTime:
            assert seconds is not None
            overtimes += 1
            if overtimes == MAX_OVERTIMES:
                return timed_out(seconds)
            continue
        if not isinstance(result, Crashed):
            return result
        if result.by_machine:
            on_fault(result)
            faults += 1
            if faults == max_faults:
                return result
        elif result.died:
            deaths += 1
            if deaths == MAX_DEATHS:
                return gave_up(result, deaths)
        else:
            return result


def attempt_in_time(worker: Worker, task: Any, seconds: float | None) -> Any:
    """`attempt(worker, task)` in this process.

    Raises:
        OutOfTime: it took longer than `seconds`.
        InputError: the user's input is wrong; this ends the run.
    """
    with time_limit(seconds):
        return attempt(worker, task)


def attempt(worker: Worker, task: Any) -> Any:
    """`worker(task)`, with an exception turned into a `Crashed`.

    Raises:
        InputError: the user's input is wrong; this ends the run.
    """
    try:
        return worker(task)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # the worker boundary: an exception costs this task only
        return crash_of(error)
