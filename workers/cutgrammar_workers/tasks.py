"""What a worker is given and what can come of it: tasks, results, and crashes as values."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from cutgrammar.errors import InputError


class Tasks(Protocol):
    """A sequence of tasks, or something that makes them on demand."""

    def __len__(self) -> int:
        """How many there are."""
        ...

    def __getitem__(self, index: int, /) -> Any:
        """The task of that number, from 0."""
        ...


@dataclass(frozen=True)
class Crashed:
    """What came of a task whose worker raised an exception, or died on it again and again.

    Attributes:
        reason: one line.
        traceback: where it was raised; empty if the process died.
    """

    reason: str
    traceback: str


def attempt(worker: Callable[[Any], Any], task: Any) -> Any:
    """`worker(task)`, where an exception becomes a `Crashed`; the user's errors go on to the driver."""
    try:
        return worker(task)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # the worker boundary: what went wrong costs this task only
        return Crashed(f"{type(error).__name__}: {error}", traceback.format_exc())
