"""Many tasks for workers of one kind: in this process, or on Ray actors of this machine or a cluster.

The caller gets the result of every task exactly once, in order of completion, even if actors die. A task may be carried
out more than once, so a worker must have no side effects: it takes a task and returns a result for the driver to store.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar_workers.own_process import OwnProcess
from cutgrammar_workers.tasks import (
    MAX_FAULTS,
    START_SECONDS,
    OnFault,
    Tasks,
    Unfit,
    WorkerFactory,
    attempt_in_time,
    build,
    nowhere,
    settle,
    what_hangs,
)


def no_task(_: Any) -> bool:
    """Whether a task is isolated: none is."""
    return False


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
    max_faults: int = MAX_FAULTS,
    on_fault: OnFault = nowhere,
    is_isolated: Callable[[Any], bool] = no_task,
    on_pause: Callable[[], None] = nowhere,
    max_start_seconds: float = START_SECONDS,
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
        max_faults: the failure budget: a task is repeated after a fault of the machine, up to so many times in all,
            and then has a result `Crashed` that is `by_machine`.
        on_fault: called in this process for each such fault.
        on_pause: called in this process before it waits for a result, none being there; what results ask for can be
            done then for many at once. It is not called after the last result.
        is_isolated: which tasks could end their process, and run in a child process where there are no workers.
        max_start_seconds: a worker that takes longer to be built, from when its process is there, is replaced; its
            node is set aside if that recurs.

    Raises:
        InputError: a worker found the user's input wrong, there is no cluster at `address`, or no worker could be built
            in time.
    """
    if not len(tasks):
        return
    if workers != 0:
        from cutgrammar_workers.actor_pool import run_on_actors  # importing Ray takes a second

        run_on_actors(
            make_worker,
            shared,
            tasks,
            on_result,
            workers,
            address,
            planners,
            py_modules,
            max_seconds,
            max_faults,
            on_fault,
            on_pause,
            max_start_seconds,
        )
        return
    worker, child = build(make_worker, shared, max_start_seconds), None
    if isinstance(worker, Unfit):
        raise InputError(what_hangs(worker.reason))
    try:
        for index in range(len(tasks)):
            on_pause()
            task = tasks[index]
            if is_isolated(task):
                child = child or OwnProcess(make_worker, shared, max_start_seconds)
                call = partial(child, task, max_seconds)
            else:
                call = partial(attempt_in_time, worker, task, max_seconds)
            on_result(index, settle(call, max_seconds, max_faults, partial(on_fault, index)))
    finally:
        if child is not None:
            child.close()


def n_workers(workers: int | None) -> int:
    """`workers`, or the number of cores of the Ray that this process has joined; without one, of this machine."""
    if workers is not None:
        return workers
    from cutgrammar_workers.ray_session import cores

    return cores()
