"""Tasks that misbehave, and workers that die, cost themselves only, with child processes as with Ray."""

import re
import socket

import pytest

from cutgrammar.errors import InputError
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import Crashed, TimedOut
from squarer import Squarer, Task, results_of


@pytest.fixture(params=[0, pytest.param(2, marks=pytest.mark.slow)])
def workers(request):
    """Number of workers; those of Ray are on one Ray for all tests, since each start takes seconds."""
    if request.param:
        request.getfixturevalue("two_cpus")
    return request.param


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
@pytest.mark.usefixtures("two_cpus")
def test_a_task_that_never_ends_and_a_stopped_worker_cost_no_other_task(tmp_path):
    mischief = {2: "never end", 5: "stop once"}
    results = results_of([Task(i, mischief.get(i, "")) for i in range(12)], tmp_path, 2, max_seconds=3.0)
    assert isinstance(results.pop(2), TimedOut)
    assert results == {i: i**2 for i in range(12) if i != 2}


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
@pytest.mark.usefixtures("two_cpus")
def test_results_are_the_same_for_any_number_of_workers(tmp_path):
    tasks = [Task(i, "raise" if i == 5 else "") for i in range(20)]

    def reasons(workers):
        found = results_of(tasks, tmp_path, workers)
        return {i: r.reason if isinstance(r, Crashed) else r for i, r in found.items()}

    assert reasons(0) == reasons(1) == reasons(2)


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
def test_killed_actors_lose_nothing_and_repeat_nothing(tmp_path):
    tasks = [Task(i, "die once" if i in (3, 7, 8) else "") for i in range(30)]
    assert results_of(tasks, tmp_path, 2) == {i: i**2 for i in range(30)}


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
def test_a_task_that_kills_three_new_actors_alone_is_given_up_and_no_other_is_lost(tmp_path):
    tasks = [Task(i, "die always" if i == 4 else "") for i in range(10)]
    results = results_of(tasks, tmp_path, 2)
    assert re.match(r"its process died 3 times: process \d+ on \S+ was ended by SIGKILL$", results.pop(4).reason)
    assert results == {i: i**2 for i in range(10) if i != 4}
    assert (tmp_path / "deaths").read_text().split() == ["4"] * 4  # in company once, then alone three times


def test_a_task_that_ends_its_process_by_its_own_doing_has_crashed_with_signal_process_and_place(tmp_path, workers):
    tasks = [Task(0), Task(1, "exit"), Task(2, "segfault"), Task(3)]
    results = results_of(tasks, tmp_path, workers, is_isolated=lambda task: bool(task.mischief))
    assert (results[0], results[3]) == (0, 9)
    assert re.match(r"its process died 3 times: process \d+ on \S+ exited with code 3$", results[1].reason)
    assert re.match(r"its process died 3 times: process \d+ on \S+ was ended by SIGSEGV$", results[2].reason)
    assert "Segmentation fault" in results[2].traceback
    assert "squarer.py" in results[2].traceback
    assert not results[1].by_machine
    assert results[2].host == socket.gethostname()


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
@pytest.mark.usefixtures("two_cpus")
def test_a_terminated_worker_does_not_raise_inside_its_task(tmp_path):
    tasks = [Task(0), Task(1, "terminated once and caught"), Task(2)]
    assert results_of(tasks, tmp_path, 1) == {0: 0, 1: 1, 2: 4}


def test_without_workers_compiled_code_that_never_returns_is_stopped_in_its_child_process(tmp_path):
    tasks = [Task(1), Task(2, "spin"), Task(3)]
    results = results_of(tasks, tmp_path, 0, max_seconds=0.5, is_isolated=lambda task: bool(task.mischief))
    assert isinstance(results.pop(1), TimedOut)
    assert results == {0: 1, 2: 9}


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
def test_errors_of_the_user_and_of_the_workers_construction_reach_the_driver_through_ray(tmp_path):
    with pytest.raises(InputError, match="the mesh is open"):
        results_of([Task(1), Task(2, "user error")], tmp_path, 1)
    (tmp_path / "unbuildable").touch()
    with pytest.raises(RuntimeError, match="cannot be built"):
        results_of([Task(1)], tmp_path, 1)
