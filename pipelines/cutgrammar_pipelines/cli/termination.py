"""SIGTERM, with which clusters, schedulers and service managers end a program, treated as Ctrl-C is."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

AFTER_IMPORT = 0.1
"""Time after which a signal that arrives during an import is sent again [s]."""


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

    def stop(signal_number: int, frame: FrameType | None) -> None:
        if arrived.is_set():
            return
        if _imports(frame):
            later = threading.Timer(AFTER_IMPORT, os.kill, (os.getpid(), signal_number))
            later.daemon = True
            later.start()
            return
        arrived.set()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield arrived.is_set
    finally:
        signal.signal(signal.SIGTERM, before)


def _imports(frame: FrameType | None) -> bool:
    """Whether a module is being imported; compiled modules can swallow what is raised in them."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
