"""The tasks of workers, and how a crash becomes a result."""

import errno
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from cutgrammar.errors import InputError
from cutgrammar_workers.time_limit import OutOfTime, time_limit

Worker = Callable[[Any], Any]
"""task -> result."""

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
        traceback: where the exception was raised; empty if the process died.
        by_machine: whether the machine was at fault and not the task: its memory or its disk was full, or its node
            died, `MAX_FAULTS` times.
    """

    reason: str
    traceback: str
    by_machine: bool = False


MAX_FAULTS = 5
"""The failure budget: a task that has met so many faults of the machine is given up for this run, and not scored."""


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
    """

    reason: str


MAX_TEXT = 10_000
"""Longer texts of exceptions and of methods are cut off."""


def printable(text: str) -> str:
    """A text that can be stored and printed: without lone surrogates, and at most `MAX_TEXT` characters of it."""
    short = text if len(text) <= MAX_TEXT else f"{text[:MAX_TEXT]} ..."
    return short.encode("utf-8", "backslashreplace").decode()


def crash_of(error: BaseException) -> Crashed:
    """An exception as a result, to be called where it is handled."""
    try:
        reason = f"{type(error).__name__}: {error}"
        trace = traceback.format_exc()
    except Exception:  # noqa: BLE001  # the text of the exception raises one itself
        return Crashed(f"{type(error).__name__}, which has no text", "")
    return Crashed(printable(reason), printable(trace[-MAX_TEXT:]), is_fault_of_machine(error))


MAX_OVERTIMES = 2
"""A task that has exceeded its time limit so often is given up: it is tried once more, on a new worker."""


def timed_out(seconds: float) -> TimedOut:
    """The result of a task that exceeded a limit of `seconds`."""
    return TimedOut(f"it was stopped after {seconds:g} s, {MAX_OVERTIMES} times (trial.max_seconds)")


def attempt_in_time(worker: Worker, task: Any, seconds: float | None) -> Any:
    """`attempt(worker, task)` in this process, repeated once if it takes longer than `seconds`, then `TimedOut`.

    Faults of the machine are met by repeating the task, too.

    Raises:
        InputError: the user's input is wrong; this ends the run.
    """
    faults = overtimes = 0
    while True:
        try:
            with time_limit(seconds):
                result = attempt(worker, task)
        except OutOfTime:
            assert seconds is not None
            overtimes += 1
            if overtimes == MAX_OVERTIMES:
                return timed_out(seconds)
            continue
        faults += isinstance(result, Crashed) and result.by_machine
        if not (isinstance(result, Crashed) and result.by_machine) or faults == MAX_FAULTS:
            return result


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
