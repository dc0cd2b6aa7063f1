"""A relay as a Ray actor on the driver's node; see `relays`."""

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from cutgrammar.trials.news import News, Outlet
from cutgrammar_workers.relays import MAX_ON_THEIR_WAY, START_SECONDS, host, patience

GATHER_SECONDS = 0.2
"""News wait for one another for so long [s]: a call of an actor takes a millisecond of its caller."""


class RelayActor:
    """The class of the actor."""

    def __init__(self, reference: str, arguments: tuple[Any, ...]) -> None:
        self._show = host(reference, arguments)

    def show(self, gathered: Sequence[News]) -> None:
        """Show some news, in order."""
        for news in gathered:
            self._show(news)

    def close(self) -> None:
        """Show what is left."""
        self._show.close()


class ActorOutlet:
    """Sends news to the actor, several at a time, unless too many of this process wait or are on their way.

    Args:
        handle: Ray's handle of the `RelayActor`.
    """

    def __init__(self, handle: Any) -> None:
        self._handle = handle
        self._lock = threading.Lock()
        self._waiting: list[News] = []
        self._on_their_way: dict[Any, int] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return ActorOutlet, (self._handle,)

    def __call__(self, news: News) -> None:
        """Take, or drop."""
        with self._lock:
            if self._count() >= MAX_ON_THEIR_WAY:
                self._forget_arrived()
            if self._count() >= MAX_ON_THEIR_WAY:
                return
            self._waiting.append(news)
            count = len(self._waiting)
        if count == MAX_ON_THEIR_WAY // 2:
            self.flush()
        elif count == 1:
            timer = threading.Timer(GATHER_SECONDS, self.flush)
            timer.daemon = True
            timer.start()

    def flush(self) -> None:
        """Send what waits."""
        with self._lock:
            gathered, self._waiting = self._waiting, []
            if gathered:
                self._on_their_way[self._handle.show.remote(gathered)] = len(gathered)

    def _count(self) -> int:
        return len(self._waiting) + sum(self._on_their_way.values())

    def _forget_arrived(self) -> None:
        """Of an actor that has died, all calls have arrived."""
        if not self._on_their_way:
            return
        arrived, _ = ray.wait(list(self._on_their_way), num_returns=len(self._on_their_way), timeout=0)
        for call in arrived:
            del self._on_their_way[call]


@contextlib.contextmanager
def started(reference: str, arguments: tuple[Any, ...]) -> Iterator[Outlet]:
    """The actor for the length of a `with` block, within a Ray session; at the end it is killed, whatever it does."""
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    remote = ray.remote(RelayActor).options(num_cpus=0, max_restarts=0, scheduling_strategy=here)
    handle = remote.remote(reference, arguments)
    outlet = ActorOutlet(handle)
    began = time.monotonic()
    try:
        yield outlet
    finally:
        outlet.flush()
        allowed = patience(time.monotonic() - began)
        ray.wait([handle.__ray_ready__.remote()], timeout=START_SECONDS)
        ray.wait([handle.close.remote()], timeout=allowed)
        ray.kill(handle)
