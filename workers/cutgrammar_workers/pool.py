"""Many tasks, one kind of worker: in this process, or spread over Ray actors on a laptop or a cluster.

The caller gets every task's result exactly once, in order of completion, whatever died on the way. Work is carried out
at least once, so a worker must not leave effects behind: it takes a task and returns a result, and the driver keeps it.
"""

from collections.abc import Callable, Sequence
from typing import Any

from cutgrammar_workers.tasks import Tasks, attempt


def run_all(
    worker: Callable[[Any], Callable[[Any], Any]],
    shared: Any,
    tasks: Tasks,
    on_result: Callable[[int, Any], None],
    workers: int,
    address: str | None = None,
    planners: int = 1,
    py_modules: Sequence[str] = (),
) -> None:
    """Call `worker(shared)(task)` for every task and hand each result to `on_result(index, result)` here.

    Args:
        worker: a class of an importable module; it is built from `shared` once a process.
        shared: what all tasks need; sent to each node once.
        tasks: may be made on demand: each is asked for when its turn comes, and again should its worker die.
        on_result: called in this process, in order of completion, once for every task.
        workers: number of processes; 0 runs in this one without Ray.
        address: of a running Ray cluster, "auto" for the one on this machine; None starts one of our own.
        planners: processes that each worker starts for itself (`planner_actor`); the workers' number is lowered so
            that all together need no more than `workers` CPUs.
        py_modules: folders of further packages (plugins) to send to a cluster that is joined.

    Raises:
        InputError: a worker found the user's input wrong, or there is no cluster at `address`.
    """
    if not len(tasks):
        return
    if workers > 0:
        from cutgrammar_workers import ray_pool  # Ray takes a second to import and is not always wanted

        ray_pool.run_all(worker, shared, tasks, on_result, workers, address, planners, py_modules)
        return
    made = worker(shared)
    for index in range(len(tasks)):
        on_result(index, attempt(made, tasks[index]))
