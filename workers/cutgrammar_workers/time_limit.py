"""A time limit for tasks that run in the process of the driver."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

REPEAT_SECONDS = 5.0
"""The exception is raised again after so long, should a task have caught it [s]."""


class OutOfTime(BaseException):
    """A task has run for longer than it may; no `Exception`, so that a task does not take it for one of its own."""


@contextlib.contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Raise `OutOfTime` inside a `with` block that takes longer than `seconds`.

    The limit interrupts Python code and waiting. Compiled code is interrupted when it returns to Python; code that
    never does is stopped only on a Ray worker, whose process can be killed. Without effect outside the main thread and
    on systems without SIGALRM.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if seconds is None or not is_main or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(_signal_number: int, _frame: FrameType | None) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds, REPEAT_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
