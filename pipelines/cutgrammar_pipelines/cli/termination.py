"""SIGTERM, with which clusters, schedulers and service managers end a program, treated as Ctrl-C is."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType


@contextlib.contextmanager
def terminable() -> Iterator[Callable[[], bool]]:
    """Raise `KeyboardInterrupt` inside a `with` block when SIGTERM arrives; a second one does not disturb the cleaning.

    Yields a function that tells whether SIGTERM has arrived; an exception of its own would not, because Ray's waiting
    turns it into a plain `KeyboardInterrupt`. Without effect outside the main thread, which alone can handle signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    arrived = threading.Event()

    def stop(_signal_number: int, _frame: FrameType | None) -> None:
        if not arrived.is_set():
            arrived.set()
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield arrived.is_set
    finally:
        signal.signal(signal.SIGTERM, before)
