"""Planner actors: several processes that share the independent searches of one planner.

The searches are pure functions of their arguments, so the results do not depend on where each ran or in which order
they came; a search whose process dies is made again.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import ray

from cutgrammar_workers.ray_pool import Crew
from cutgrammar_workers.tasks import Crashed

A = TypeVar("A")
B = TypeVar("B")


class Searcher:
    """Applies a function that lies in Ray's object store to one argument."""

    def __init__(self, shared: None) -> None:
        del shared

    def __call__(self, task: tuple[Any, Any]) -> Any:
        """The function's result."""
        function, argument = task
        return ray.get(function)(argument)


class PlannerCrew:
    """A `ParallelMap` over planner actors that live as long as the process that made it."""

    def __init__(self, size: int, cpus: float = 1.0) -> None:
        """Start the actors.

        Args:
            size: number of actors.
            cpus: that each of them claims.
        """
        self._crew = Crew(Searcher, None, size, cpus)

    def __call__(self, function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
        """`[function(x) for x in arguments]`, each wherever there is room.

        Raises:
            RuntimeError: the function raised an exception, or its process died three times.
        """
        shared = ray.put(function)
        tasks = [(shared, argument) for argument in arguments]
        results: dict[int, Any] = {}
        self._crew.run(tasks, results.__setitem__)
        for result in results.values():
            if isinstance(result, Crashed):
                raise RuntimeError(f"a planner actor failed: {result.reason}\n{result.traceback}")
        return [results[index] for index in range(len(tasks))]

    def close(self) -> None:
        """End the actors."""
        self._crew.close()
