"""The tasks of workers, and how a crash becomes a result."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from cutgrammar.errors import InputError

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
        return Crashed(f"{type(error).__name__}: {error}", traceback.format_exc())
