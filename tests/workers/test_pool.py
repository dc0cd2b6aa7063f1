import ctypes
import errno
import os
import re
import signal
import socket
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import Crashed, TimedOut


@dataclass(frozen=True)
class Task:
    number: int
    mischief: str = ""


class Squarer:
    """Squares numbers; some tasks misbehave. `shared` is a folder in which deaths are counted."""

    def __init__(self, shared):
        self.folder = Path(shared)
        if (self.folder / "unbuildable").exists():
            raise RuntimeError("cannot be built")

    def __call__(self, task):
        if task.mischief == "raise":
            raise ZeroDivisionError("seven")
        if task.mischief == "user error":
            raise InputError("the mesh is open")
        if task.mischief == "be slow":
            time.sleep(0.2)
        if task.mischief == "never end":
            time.sleep(600.0)
        if task.mischief == "disk full once" and not (self.folder / f"full-{task.number}").exists():
            (self.folder / f"full-{task.number}").touch()
            raise OSError(errno.ENOSPC, "no space")
        if task.mischief == "memory full":
            raise MemoryError("too large")
        if task.mischief == "stop once" and not (self.folder / f"stopped-{task.number}").exists():
            (self.folder / f"stopped-{task.number}").touch()
            os.kill(os.getpid(), signal.SIGSTOP)
        if task.mischief == "die once" and not (self.folder / f"died-{task.number}").exists():
            (self.folder / f"died-{task.number}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if task.mischief == "spin":
            ctypes.PyDLL(None).pause()  # keeps Python's lock
        if task.mischief == "exit":
            os._exit(3)
        if task.mischief == "segfault":
            ctypes.string_at(0)
        if task.mischief.startswith("killed"):
            kill_from_outside(self.folder, task, "KILL", int(task.mischief.split()[1]))
        if task.mischief == "terminated once and caught":
            try:
                kill_from_outside(self.folder, task, "TERM", 1)
            except SystemExit:
                return "caught"
        if task.mischief == "die always":
            with (self.folder / "deaths").open("a") as log:
                log.write(f"{task.number}\n")
            os.kill(os.getpid(), signal.SIGKILL)
        return task.number**2


def kill_from_outside(folder, task, name, n):
    """Another program sends a signal to this process, `n` times in all."""
    times = len(list(folder.glob(f"killed-{task.number}-*")))
    if times < n:
        (folder / f"killed-{task.number}-{times}").touch()
        subprocess.run(["/bin/kill", f"-{name}", str(os.getpid())], check=True)
        time.sleep(60.0)


def results_of(tasks, folder, workers, **more):
    results = []
    run_all(Squarer, str(folder), tasks, lambda index, result: results.append((index, result)), workers, **more)
    assert len({index for index, _ in results}) == len(results), "a result came twice"
    return dict(results)


def test_without_workers_tasks_run_in_this_process_in_order(tmp_path):
    results = []
    run_all(Squarer, str(tmp_path), [Task(i) for i in range(4)], lambda *r: results.append(r), 0)
    assert results == [(0, 0), (1, 1), (2, 4), (3, 9)]


def test_an_exception_becomes_a_crashed_result_with_its_traceback(tmp_path):
    results = results_of([Task(1), Task(2, "raise"), Task(3)], tmp_path, 0)
    assert results[0] == 1
    assert results[2] == 9
    assert results[1].reason == "ZeroDivisionError: seven"
    assert 'raise ZeroDivisionError("seven")' in results[1].traceback


def test_without_workers_a_task_that_never_ends_is_stopped_twice_and_costs_no_other(tmp_path):
    tasks = [Task(1), Task(2, "never end"), Task(3)]
    results = results_of(tasks, tmp_path, 0, max_seconds=0.05)
    assert results.pop(1) == TimedOut("it was stopped after 0.05 s, 2 times (trial.max_seconds)")
    assert results == {0: 1, 2: 9}


@pytest.mark.slow
def test_a_task_that_never_ends_and_a_stopped_worker_cost_no_other_task(tmp_path):
    mischief = {2: "never end", 5: "stop once"}
    results = results_of([Task(i, mischief.get(i, "")) for i in range(12)], tmp_path, 2, max_seconds=3.0)
    assert isinstance(results.pop(2), TimedOut)
    assert results == {i: i**2 for i in range(12) if i != 2}


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_faults_of_the_machine_are_met_by_repeating_and_told_apart(tmp_path, workers):
    mischief = {1: "disk full once", 3: "memory full", 4: "raise"}
    results = results_of([Task(i, mischief.get(i, "")) for i in range(8)], tmp_path, workers)
    assert (results[3].by_machine, results[3].reason) == (True, "MemoryError: too large")
    assert not results[4].by_machine
    assert [results[i] for i in (0, 1, 2, 5, 6, 7)] == [0, 1, 4, 25, 36, 49]


def test_an_error_of_the_user_stops_the_run(tmp_path):
    with pytest.raises(InputError, match="the mesh is open"):
        results_of([Task(1), Task(2, "user error")], tmp_path, 0)


def test_no_tasks_start_nothing(tmp_path):
    assert results_of([], tmp_path, 3) == {}


@pytest.mark.slow
def test_results_are_the_same_for_any_number_of_workers(tmp_path):
    tasks = [Task(i, "raise" if i == 5 else "") for i in range(20)]

    def reasons(workers):
        found = results_of(tasks, tmp_path, workers)
        return {i: r.reason if isinstance(r, Crashed) else r for i, r in found.items()}

    assert reasons(0) == reasons(1) == reasons(2)


@pytest.mark.slow
def test_killed_actors_lose_nothing_and_repeat_nothing(tmp_path):
    tasks = [Task(i, "die once" if i in (3, 7, 8) else "") for i in range(30)]
    assert results_of(tasks, tmp_path, 2) == {i: i**2 for i in range(30)}


@pytest.mark.slow
def test_a_task_that_kills_three_new_actors_alone_is_given_up_and_no_other_is_lost(tmp_path):
    tasks = [Task(i, "die always" if i == 4 else "") for i in range(10)]
    results = results_of(tasks, tmp_path, 2)
    assert re.match(r"its process died 3 times: process \d+ on \S+ was ended by SIGKILL$", results.pop(4).reason)
    assert results == {i: i**2 for i in range(10) if i != 4}
    assert (tmp_path / "deaths").read_text().split() == ["4"] * 4  # in company once, then alone three times


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_a_task_that_ends_its_process_by_its_own_doing_has_crashed_with_signal_process_and_place(tmp_path, workers):
    tasks = [Task(0), Task(1, "exit"), Task(2, "segfault"), Task(3)]
    results = results_of(tasks, tmp_path, workers, is_isolated=lambda task: bool(task.mischief))
    assert (results[0], results[3]) == (0, 9)
    assert re.match(r"its process died 3 times: process \d+ on \S+ exited with code 3$", results[1].reason)
    assert re.match(r"its process died 3 times: process \d+ on \S+ was ended by SIGSEGV$", results[2].reason)
    assert "Segmentation fault" in results[2].traceback
    assert "test_pool.py" in results[2].traceback
    assert not results[1].by_machine
    assert results[2].host == socket.gethostname()


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_a_process_that_is_killed_from_outside_is_repeated_and_its_task_never_crashed(tmp_path, workers):
    tasks = [Task(0), Task(1, "killed 3 times"), Task(2, "killed 9 times"), Task(3)]
    faults = []
    results = results_of(
        tasks,
        tmp_path,
        workers,
        max_faults=4,
        on_fault=lambda index, crashed: faults.append((index, crashed.by_machine)),
        is_isolated=lambda task: bool(task.mischief),
    )
    assert (results[0], results[1], results[3]) == (0, 1, 9)
    assert results[2].by_machine
    assert re.match(r"process \d+ on \S+ was ended by SIGKILL from outside", results[2].reason)
    assert {index for index, by_machine in faults if by_machine} == {1, 2}
    assert [index for index, _ in faults].count(2) == 4


@pytest.mark.slow
def test_a_terminated_worker_does_not_raise_inside_its_task(tmp_path):
    tasks = [Task(0), Task(1, "terminated once and caught"), Task(2)]
    assert results_of(tasks, tmp_path, 1) == {0: 0, 1: 1, 2: 4}


def test_without_workers_compiled_code_that_never_returns_is_stopped_in_its_child_process(tmp_path):
    tasks = [Task(1), Task(2, "spin"), Task(3)]
    results = results_of(tasks, tmp_path, 0, max_seconds=0.5, is_isolated=lambda task: bool(task.mischief))
    assert isinstance(results.pop(1), TimedOut)
    assert results == {0: 1, 2: 9}


@pytest.mark.slow
def test_errors_of_the_user_and_of_the_workers_construction_reach_the_driver_through_ray(tmp_path):
    with pytest.raises(InputError, match="the mesh is open"):
        results_of([Task(1), Task(2, "user error")], tmp_path, 1)
    (tmp_path / "unbuildable").touch()
    with pytest.raises(RuntimeError, match="cannot be built"):
        results_of([Task(1)], tmp_path, 1)


@pytest.mark.slow
def test_an_address_without_a_cluster_is_one_clear_line(tmp_path):
    with pytest.raises(InputError, match=r"no Ray cluster answers at '127\.0\.0\.1:1'") as caught:
        results_of([Task(1)], tmp_path, 1, address="127.0.0.1:1")
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_cluster_is_joined_and_no_result_is_lost_with_a_node(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    lost = cluster.add_node(num_cpus=1)
    results = []

    def on_result(index, result):
        results.append((index, result))
        if len(results) == 30:  # both nodes have work in flight
            cluster.remove_node(lost, allow_graceful=False)

    try:
        tasks = [Task(i, "be slow") for i in range(60)]
        run_all(Squarer, str(tmp_path), tasks, on_result, 2, address=cluster.address)
    finally:
        cluster.shutdown()
    assert sorted(results) == [(i, i**2) for i in range(60)]


@pytest.mark.slow
def test_a_cluster_without_its_head_is_given_up_with_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    from cutgrammar_workers import lifeline

    monkeypatch.setattr(lifeline, "CHECK_SECONDS", 0.5)
    monkeypatch.setitem(lifeline.MAX_SILENT_SECONDS, "head", 3.0)

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    killer = threading.Timer(12.0, cluster.head_node.kill_gcs_server)
    killer.start()
    try:
        with pytest.raises(ConnectionError, match=r"the Ray cluster's head at .* has not answered for \d+ s$"):
            results_of([Task(1, "never end")], tmp_path, 1, address=cluster.address)
    finally:
        killer.join()
        cluster.shutdown()
