"""Several processes that share the independent searches of one planner.

The searches are pure functions of their arguments, so the results do not depend on where or in which order they run. A
search whose process dies is repeated, and in the end carried out by the process that asked for it.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import ray

from cutgrammar_workers.actor_pool import ActorPool
from cutgrammar_workers.tasks import Crashed, nowhere

A = TypeVar("A")
B = TypeVar("B")


class PlannerPool:
    """A `ParallelMap` over Ray actors.

    Args:
        size: number of actors.
        cpus: CPUs that each of them claims.
    """

    def __init__(self, size: int, cpus: float = 1.0) -> None:
        self._pool = ActorPool(_make_caller, None, size, cpus, has_children=False)

    def __call__(self, function: Callable[[A], B], arguments: Iterable[A]) -> list[B]:
        """`[function(x) for x in arguments]`, spread over the actors.

        Raises:
            RuntimeError: the function raised an exception.
        """
        shared = ray.put(function)
        tasks = [(shared, argument) for argument in arguments]
        results: dict[int, Any] = {}
        self._pool.run(tasks, results.__setitem__, nowhere)
        for index, result in results.items():
            if not isinstance(result, Crashed):
                continue
            if result.died or result.by_machine:  # this process then shows whose fault it is
                results[index] = function(tasks[index][1])
            else:
                raise RuntimeError(f"a planner actor failed: {result.reason}\n{result.traceback}")
        return [results[index] for index in range(len(tasks))]

    def wait(self) -> None:
        """Wait until a planner has started.

        Raises:
            InputError: none can be started.
        """
        self._pool.wait()

    def close(self) -> None:
        """End the actors."""
        self._pool.close()


def _make_caller(_: None) -> Callable[[tuple[Any, Any]], Any]:
    """The worker: (reference to a function in Ray's object store, argument) -> the function's result."""
    return lambda task: ray.get(task[0])(task[1])
