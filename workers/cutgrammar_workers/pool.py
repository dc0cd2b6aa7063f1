"""Many tasks for workers of one kind: in this process, or on Ray actors of this machine or a cluster.

The caller gets the result of every task exactly once, in order of completion, even if actors die. A task may be carried
out more than once, so a worker must have no side effects: it takes a task and returns a result for the driver to store.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cutgrammar_workers.tasks import Tasks, WorkerFactory, attempt_in_time


def run_all(
    make_worker: WorkerFactory,
    shared: Any,
    tasks: Tasks,
    on_result: Callable[[int, Any], None],
    workers: int | None,
    address: str | None = None,
    planners: int = 1,
    py_modules: Sequence[Path] = (),
    max_seconds: float | None = None,
) -> None:
    """Call `make_worker(shared)(task)` for every task and hand each result to `on_result(index, result)` here.

    Args:
        make_worker: makes the worker of a process from `shared`.
        shared: data that all tasks need; it is sent to each node once.
        tasks: each is taken when its turn comes, and again if its actor dies.
        on_result: called in this process, in order of completion, once for every task.
        workers: number of processes; 0 runs in this one without Ray; None is the number of cores, of the cluster if
            `address` is given.
        address: of a running Ray cluster, "auto" for the one on this machine; None starts a local one.
        planners: processes that each worker starts for itself (`planner_pool`); the number of workers is reduced so
            that all processes together need no more than `workers` CPUs.
        py_modules: folders of further packages (plugins), or modules, to send to a cluster that is joined.
        max_seconds: a task that runs for longer is stopped with its worker, tried once more on a new one, and then
            has the result `TimedOut`; without workers see `time_limit`.

    Raises:
        InputError: a worker found the user's input wrong, or there is no cluster at `address`.
    """
    if not len(tasks):
        return
    if workers != 0:
        from cutgrammar_workers.actor_pool import run_on_actors  # importing Ray takes a second

        run_on_actors(make_worker, shared, tasks, on_result, workers, address, planners, py_modules, max_seconds)
        return
    worker = make_worker(shared)
    for index in range(len(tasks)):
        on_result(index, attempt_in_time(worker, tasks[index], max_seconds))


def n_workers(workers: int | None) -> int:
    """`workers`, or the number of cores of the Ray that this process has joined; without one, of this machine."""
    if workers is not None:
        return workers
    from cutgrammar_workers.ray_session import cores

    return cores()
