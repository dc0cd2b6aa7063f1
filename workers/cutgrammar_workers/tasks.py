"""The tasks of workers, and how a crash becomes a result."""

import contextlib
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
    """

    reason: str
    traceback: str


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
    return Crashed(printable(reason), printable(trace[-MAX_TEXT:]))


MAX_OVERTIMES = 2
"""A task that has exceeded its time limit so often is given up: it is tried once more, on a new worker."""


def timed_out(seconds: float) -> TimedOut:
    """The result of a task that exceeded a limit of `seconds`."""
    return TimedOut(f"it was stopped after {seconds:g} s, {MAX_OVERTIMES} times (trial.max_seconds)")


def attempt_in_time(worker: Worker, task: Any, seconds: float | None) -> Any:
    """`attempt(worker, task)` in this process, repeated once if it takes longer than `seconds`, then `TimedOut`.

    Raises:
        InputError: the user's input is wrong; this ends the run.
    """
    for _ in range(MAX_OVERTIMES):
        with contextlib.suppress(OutOfTime), time_limit(seconds):
            return attempt(worker, task)
    assert seconds is not None
    return timed_out(seconds)


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
