"""Workers that hang while they are built, as a plugin or shared storage lets them, cost time and no result."""

import os
import re
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
import ray

import hanging_doubler
from cutgrammar.errors import InputError
from cutgrammar_workers.actor_pool import ActorPool
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import nowhere
from hanging_doubler import Doubler, Shared

HERE = re.escape(hanging_doubler.__file__)


def test_without_workers_the_run_ends_and_says_where_it_hung(tmp_path):
    with pytest.raises(InputError) as caught:
        run_all(Doubler, Shared(tmp_path, "sleep"), [1], nowhere, 0, max_start_seconds=0.2)
    assert re.match(rf"a worker was not built within 0\.2 s, and was at {HERE}:\d+; see what hangs", str(caught.value))


@pytest.mark.parametrize("mischief", ["sleep", "spin"])
def test_a_child_process_that_hangs_while_it_is_built_is_a_fault_of_the_machine(tmp_path, mischief):
    shared, results = Shared(tmp_path, mischief, driver=os.getpid()), {}
    run_all(
        Doubler,
        shared,
        [1, 2],
        results.__setitem__,
        0,
        is_isolated=lambda task: task == 2,
        max_start_seconds=4.0,
        max_faults=1,
    )
    assert results[0] == 2
    assert results[1].by_machine
    assert re.match(r"a worker was not built within 4 s in process \d+ on \S+$", results[1].reason)
    assert f'File "{hanging_doubler.__file__}"' in results[1].traceback


def is_gone(built):
    """Whether the process that left such a file ends within a minute."""
    process, deadline = Path(f"/proc/{built.read_text()}"), time.monotonic() + 60.0
    while process.exists() and time.monotonic() < deadline:
        time.sleep(0.1)  # the system takes a moment to remove a process that was killed
    return not process.exists()


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
@pytest.mark.parametrize("mischief", ["sleep", "stop", "spin"])
def test_an_actor_that_hangs_while_it_is_built_is_replaced_and_leaves_no_process(tmp_path, mischief, monkeypatch):
    monkeypatch.setattr("cutgrammar_workers.actor_pool.BUILD_SECONDS", 1.0)
    results = {}
    run_all(Doubler, Shared(tmp_path, mischief, times=1), range(9), results.__setitem__, 2, max_start_seconds=2.0)
    assert results == {i: 2 * i for i in range(9)}
    (built,) = tmp_path.glob("built-*")
    assert is_gone(built)


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
@pytest.mark.parametrize(("mischief", "where"), [("sleep", rf", and was at {HERE}:\d+"), ("stop", "")])
def test_a_run_whose_workers_all_hang_ends_with_one_line(tmp_path, mischief, where, monkeypatch):
    monkeypatch.setattr("cutgrammar_workers.actor_pool.BUILD_SECONDS", 1.0)
    with pytest.raises(InputError) as caught:
        run_all(Doubler, Shared(tmp_path, mischief), range(9), nowhere, 1, max_start_seconds=2.0)
    told = rf"a worker was not built within 2 s{where} \(process \d+ on \S+\); see what hangs there, such as a plugin's"
    assert re.match(told, str(caught.value))
    built = list(tmp_path.glob("built-*"))
    assert len(built) == 2  # the second proves that it is no chance
    assert all(map(is_gone, built))


class Waiting:
    """Lets its first task wait for what is not its own time."""

    def __init__(self, _):
        self.is_ready = False

    def wait(self):
        time.sleep(4.0)
        self.is_ready = True

    def __call__(self, task):
        return self.is_ready, task


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
def test_what_a_worker_waits_for_is_no_time_of_its_start_or_of_its_task():
    results = {}
    run_all(Waiting, None, range(2), results.__setitem__, 1, max_seconds=2.0, max_start_seconds=2.0)
    assert results == {0: (True, 0), 1: (True, 1)}


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
def test_planners_that_hang_while_they_are_built_are_replaced_or_given_up(tmp_path):
    def pool(times):
        shared = ray.put(Shared(tmp_path, "sleep", times))
        return ActorPool(Doubler, shared, 2, 1.0, has_children=False, max_start_seconds=2.0)

    planners, results = pool(times=1), {}
    planners.wait()
    planners.run(range(5), results.__setitem__, nowhere)
    planners.close()
    assert results == {i: 2 * i for i in range(5)}
    planners = pool(times=10**6)
    with pytest.raises(InputError, match="a worker was not built within 2 s"):
        planners.wait()
    planners.close()


@pytest.mark.slow
@pytest.mark.usefixtures("two_cpus")
def test_a_factory_that_no_worker_can_import_ends_the_run_with_one_line(monkeypatch):
    here_only = type("HereOnly", (), {"__init__": lambda *_: None, "__module__": "here_only"})
    module = ModuleType("here_only")
    module.HereOnly = here_only
    monkeypatch.setitem(sys.modules, "here_only", module)
    with pytest.raises(InputError, match=r"workers keep dying while they start: .*No module named 'here_only'; see"):
        run_all(here_only, None, range(3), nowhere, 1)
