"""A watch over the Ray that this process has joined.

When the head or this machine's own node of a cluster dies, Ray's calls wait for ever or Ray ends the process, after
a minute and with many lines. The watch interrupts the process sooner.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Mapping

CHECK_SECONDS = 2.0
"""Time between two checks [s]."""
MAX_SILENT_SECONDS = {"head": 40.0, "own node": 3.0}
"""A part that has not answered for so long is given up [s]; a head that restarts answers sooner."""
START_SECONDS = 60.0
"""Time limit of Ray's start or of joining a cluster [s]; on a crowded machine, Ray has waited for ever."""
LEAVE_SECONDS = 25.0
"""Time in which the interrupted process must have left Ray, or it is ended [s]."""
INTERRUPT = getattr(signal, "SIGUSR2", signal.SIGINT)
"""Interrupts the main thread; SIGINT is ignored in background jobs of shell scripts."""


class Lifeline:
    """Raises `KeyboardInterrupt` in the main thread when a part of the cluster has died.

    Attributes:
        lost: what has died, in one line; None as long as all is well.
    """

    def __init__(self) -> None:
        self.lost: str | None = None
        self._parts: dict[str, tuple[str, int]] = {}
        self._over = threading.Event()
        self._start_ends: float | None = None

    def add(self, parts: Mapping[str, tuple[str, int]]) -> None:
        """Watch further parts: a key of `MAX_SILENT_SECONDS` -> host and port."""
        self._parts |= parts

    @contextlib.contextmanager
    def start(self) -> Iterator[None]:
        """Give up what the `with` block does, the start of Ray, after `START_SECONDS`."""
        self._start_ends = time.monotonic() + START_SECONDS
        try:
            yield
        finally:
            self._start_ends = None

    def watch(self) -> None:
        """Check until the end; the main function of the watching thread."""
        answered: dict[str, float] = {}
        while not self._over.wait(CHECK_SECONDS):
            if (ends := self._start_ends) is not None and time.monotonic() > ends:
                late = f"Ray has not started within {START_SECONDS:.0f} s"
                self.lost = f"{late}, perhaps on a busy machine (--workers 0 needs no Ray)"
                self._interrupt()
                return
            for part, place in list(self._parts.items()):
                if is_listening(place):
                    answered[part] = time.monotonic()
                silent = time.monotonic() - answered.setdefault(part, time.monotonic())
                if silent > MAX_SILENT_SECONDS[part]:
                    self.lost = f"the Ray cluster's {part} at {place[0]}:{place[1]} has not answered for {silent:.0f} s"
                    self._interrupt()
                    return

    def _interrupt(self) -> None:
        os.kill(os.getpid(), INTERRUPT)
        if not self._over.wait(LEAVE_SECONDS):  # the main thread waits in Ray's code
            print(f"cutgrammar: {self.lost}; correct this and run the same command again", file=sys.stderr, flush=True)
            os._exit(1)

    def end(self) -> None:
        """Stop watching."""
        self._over.set()


@contextlib.contextmanager
def lifeline() -> Iterator[Lifeline]:
    """A watch for the length of a `with` block in the main thread.

    Raises:
        ConnectionError: a part of the cluster has died.
    """
    line = Lifeline()
    if threading.current_thread() is not threading.main_thread():
        yield line
        return
    before = signal.signal(INTERRUPT, signal.default_int_handler)
    threading.Thread(target=line.watch, daemon=True).start()
    try:
        yield line
    except KeyboardInterrupt:
        if line.lost is None:
            raise
        raise ConnectionError(line.lost) from None
    finally:
        line.end()
        signal.signal(INTERRUPT, before)


def is_listening(place: tuple[str, int]) -> bool:
    """Whether somebody listens at a host and port."""
    try:
        socket.create_connection(place, timeout=5.0).close()
    except OSError:
        return False
    return True
