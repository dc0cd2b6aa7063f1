"""One disposable process that shows a run to those who watch it.

Workers must not talk to a viewer themselves: one that hangs would block them, and keep them from exiting. They hand
their news to a relay instead, a Ray actor or, without Ray, a child process. News are dropped while too many are on
their way, so that a relay that is slow, stuck or dead costs a worker no more than the check.
"""

import contextlib
import multiprocessing
import os
import queue
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cutgrammar import plugins
from cutgrammar.trials.news import News, Outlet

MAX_ON_THEIR_WAY = 16
"""News of one process that may wait for the relay at once; those of a trial can hold a motion, of a megabyte."""
MAX_SMALL = 5000
"""The same where all news are small: enough that a relay that is slow to start shows them all."""
START_SECONDS = 20.0
"""How long the end of a short run waits for a relay that has not started yet [s]."""
CLOSE_SECONDS = 2.0
"""How long the end of a long run waits for a relay to show what it has [s]."""
CLOSE_SHARE = 0.03
"""How long the end of a run waits for that at most, as a share of the run's time."""
LEAST_CLOSE_SECONDS = 0.5
"""How long the end of a short run waits for that all the same [s]."""
NICENESS = 10
"""By how much a relay gives way to workers: a busy core leaves it a tenth."""


def patience(seconds: float) -> float:
    """How long the end of a run that took `seconds` waits for a relay to show what it has [s]."""
    return min(CLOSE_SECONDS, max(LEAST_CLOSE_SECONDS, CLOSE_SHARE * seconds))


@contextlib.contextmanager
def relay(
    reference: str,
    arguments: tuple[Any, ...],
    workers: int | None,
    address: str | None = None,
    py_modules: Sequence[Path] = (),
    max_waiting: int = MAX_ON_THEIR_WAY,
) -> Iterator[Outlet]:
    """A relay for the length of a `with` block; its outlet can be sent to workers.

    Args:
        reference: "module:attribute" of what is called with `arguments` in the relay's process, and makes a function of
            news with a method `close()`.
        arguments: see above.
        workers, address, py_modules: see `pool.run_all`; with 0 workers, the relay is a child process.
        max_waiting: news that may wait for a child process at once; further ones are dropped.
    """
    if workers != 0:
        from cutgrammar_workers.ray_session import session  # importing Ray takes a second
        from cutgrammar_workers.relay_actor import started

        with session(workers, address, py_modules), started(reference, arguments) as outlet:
            yield outlet
        return
    with _child(reference, arguments, max_waiting) as outlet:
        yield outlet


class QueueOutlet:
    """Puts news into a queue to a child process, unless it is full."""

    def __init__(self, waiting: Any) -> None:
        self._waiting = waiting

    def __call__(self, news: News) -> None:
        """Hand over, or drop."""
        with contextlib.suppress(queue.Full, ValueError):
            self._waiting.put_nowait(news)


@contextlib.contextmanager
def _child(reference: str, arguments: tuple[Any, ...], max_waiting: int) -> Iterator[Outlet]:
    context = multiprocessing.get_context("spawn")  # a fork would copy a process that may hold locks
    waiting, ready = context.Queue(max_waiting), context.Event()
    process = context.Process(target=_serve, args=(reference, arguments, waiting, ready), daemon=True)
    process.start()
    began = time.monotonic()
    try:
        yield QueueOutlet(waiting)
    finally:
        allowed = patience(time.monotonic() - began)
        deadline = time.monotonic() + START_SECONDS
        while process.is_alive() and time.monotonic() < deadline and not ready.wait(0.1):
            pass
        with contextlib.suppress(queue.Full):
            waiting.put(None, timeout=allowed / 2)
            process.join(allowed)
        process.kill()
        waiting.cancel_join_thread()
        waiting.close()


def _serve(reference: str, arguments: tuple[Any, ...], waiting: Any, ready: Any) -> None:
    """Show news until `None` comes; the main function of the child process."""
    show = host(reference, arguments)
    ready.set()
    with contextlib.suppress(KeyboardInterrupt):  # of the terminal, which the parent handles
        for news in iter(waiting.get, None):
            show(news)
        show.close()


def host(reference: str, arguments: tuple[Any, ...]) -> Any:
    """What shows news, in this process, which gives way to workers from now on."""
    if sys.platform != "win32":
        os.nice(NICENESS)
    make: Callable[..., Any] = plugins.load(reference)
    return make(*arguments)
