"""Time limits of requests to MLflow's store, whatever makes them wait: they bound what a sick store can cost."""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

MAX_SECONDS = 20.0
"""Time limit of one request [s]; MLflow's own limits do not count the waiting that a server asks for, nor bodies that
arrive byte by byte."""
QUICK_SECONDS = 1.0
"""What a request takes beyond this time is waiting [s]."""
REPEAT_SECONDS = 5.0
"""A stop is repeated after this time [s], for a library may swallow it."""


class OutOfPatience(BaseException):
    """A request has taken too long; a `BaseException`, since libraries retry what others raise."""


class Patience:
    """What requests to a store may take. Only the main thread can be interrupted; in another one there is no limit.

    Args:
        request: limit of one request [s]; None for none.
        waiting: limit of what all requests together take beyond `QUICK_SECONDS` each [s]; None for none.
    """

    def __init__(self, request: float | None, waiting: float | None = None) -> None:
        self._request, self._left = request, math.inf if waiting is None else waiting

    @contextlib.contextmanager
    def request(self) -> Iterator[None]:
        """A block that is one request.

        Raises:
            TimeoutError: a limit was exceeded.
        """
        if self._request is None or threading.current_thread() is not threading.main_thread():
            yield
            return

        def stop(*_: object) -> None:
            raise OutOfPatience

        begun, seconds = time.monotonic(), min(self._request, max(self._left, 0.0) + QUICK_SECONDS)
        before = signal.signal(signal.SIGALRM, stop)
        try:
            try:
                signal.setitimer(signal.ITIMER_REAL, seconds, REPEAT_SECONDS)
                yield
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
        except OutOfPatience:
            short = "" if seconds == self._request else ", after other requests that took long"
            raise TimeoutError(f"it has not answered for {seconds:.0f} s{short}") from None
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)  # a stop may have come before it was turned off
            signal.signal(signal.SIGALRM, before)
            self._left -= max(time.monotonic() - begun - QUICK_SECONDS, 0.0)


class Timed:
    """A client every call of which is one request.

    Args:
        client: of MLflow.
        patience: its limits.
    """

    def __init__(self, client: Any, patience: Patience) -> None:
        self._client, self._patience = client, patience

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._client, name)

        def call(*values: Any, **options: Any) -> Any:
            with self._patience.request():
                return method(*values, **options)

        return call
