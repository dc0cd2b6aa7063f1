"""A relay as a Ray actor on the driver's node; see `relays`."""

import contextlib
from collections.abc import Iterator
from typing import Any

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from cutgrammar.trials.news import News, Outlet
from cutgrammar_workers.relays import CLOSE_SECONDS, MAX_ON_THEIR_WAY, START_SECONDS, host


class RelayActor:
    """The class of the actor."""

    def __init__(self, reference: str, arguments: tuple[Any, ...]) -> None:
        self._show = host(reference, arguments)

    def show(self, news: News) -> None:
        """Show one thing."""
        self._show(news)

    def close(self) -> None:
        """Show what is left."""
        self._show.close()


class ActorOutlet:
    """Sends news to the actor, unless too many of this process are on their way.

    Args:
        handle: Ray's handle of the `RelayActor`.
    """

    def __init__(self, handle: Any) -> None:
        self._handle = handle
        self._on_their_way: list[Any] = []

    def __reduce__(self) -> tuple[Any, ...]:
        return ActorOutlet, (self._handle,)

    def __call__(self, news: News) -> None:
        """Hand over, or drop; of an actor that has died, all calls are over at once."""
        if waiting := self._on_their_way:
            _, self._on_their_way = ray.wait(waiting, num_returns=len(waiting), timeout=0)
        if len(self._on_their_way) < MAX_ON_THEIR_WAY:
            self._on_their_way.append(self._handle.show.remote(news))


@contextlib.contextmanager
def started(reference: str, arguments: tuple[Any, ...]) -> Iterator[Outlet]:
    """The actor for the length of a `with` block, within a Ray session; at the end it is killed, whatever it does."""
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    remote = ray.remote(RelayActor).options(num_cpus=0, max_restarts=0, scheduling_strategy=here)
    handle = remote.remote(reference, arguments)
    try:
        yield ActorOutlet(handle)
    finally:
        ray.wait([handle.__ray_ready__.remote()], timeout=START_SECONDS)
        ray.wait([handle.close.remote()], timeout=CLOSE_SECONDS)
        ray.kill(handle)
