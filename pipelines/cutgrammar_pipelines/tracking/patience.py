"""A time limit for every request to MLflow's store, whatever makes it wait: it bounds what a sick store can cost."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

MAX_SECONDS = 20.0
"""Time limit of one request [s]; MLflow's own limits do not count the waiting that a server asks for, nor bodies that
arrive byte by byte."""


class OutOfPatience(BaseException):
    """A request has taken too long; a `BaseException`, since libraries retry what others raise."""


class Timed:
    """A client every call of which restarts the time limit.

    Args:
        client: of MLflow.
        restart: called before each call.
    """

    def __init__(self, client: Any, restart: Callable[[], None]) -> None:
        self._client, self._restart = client, restart

    def __getattr__(self, name: str) -> Any:
        self._restart()
        return getattr(self._client, name)


@contextlib.contextmanager
def patience(seconds: float | None) -> Iterator[Callable[[], None]]:
    """A time limit that starts with the block and restarts when the yielded function is called.

    Only the main thread can be interrupted; in another one there is no limit.

    Args:
        seconds: the limit [s]; None for none.

    Raises:
        TimeoutError: the limit was exceeded.
    """
    if seconds is None or threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return

    def stop(*_: object) -> None:
        raise OutOfPatience

    def restart() -> None:
        signal.setitimer(signal.ITIMER_REAL, seconds)

    before = signal.signal(signal.SIGALRM, stop)
    restart()
    try:
        yield restart
    except OutOfPatience:
        raise TimeoutError(f"it has not answered for {seconds:.0f} s") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
