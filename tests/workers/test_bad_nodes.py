"""Nodes and planners that fail or hang cost no task of the others."""

import errno
import os
import re
import signal
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest
import ray

from cutgrammar_workers.nodes import MAX_STRIKES, Nodes
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.worker_actor import Place


@dataclass(frozen=True)
class Here:
    """What workers share.

    Attributes:
        folder: "unfit" and "full" in it hold the id of a node that lacks a package, or whose disk is full.
        planners: number of planner actors of a worker.
    """

    folder: Path
    planners: int = 1

    def alone(self) -> "Here":
        return replace(self, planners=1)


class Choosy:
    """Doubles numbers, and fails on some nodes."""

    def __init__(self, shared):
        if ray.is_initialized():
            os.environ["NODE_OF_TEST"] = ray.get_runtime_context().get_node_id()  # for child processes
        self.folder, self.node = shared.folder, os.environ["NODE_OF_TEST"]
        if self.is_here("unfit"):
            raise ModuleNotFoundError("No module named 'sapien'")

    def __call__(self, task):
        if self.is_here("full"):
            raise OSError(errno.ENOSPC, "no space left")
        while not (self.folder / "set aside").exists():
            time.sleep(0.1)  # so that the good node does not do all the work before the other one has started
        return 2 * task

    def is_here(self, fault):
        file = self.folder / fault
        return file.exists() and file.read_text() == self.node


@pytest.fixture
def two_nodes(monkeypatch):
    """A cluster; yields its address and the id of the second node."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    second = cluster.add_node(num_cpus=1)
    yield cluster.address, second.node_id
    cluster.shutdown()


def test_a_node_is_set_aside_after_faults_in_a_row_but_never_the_last_one(monkeypatch, capsys):
    every = [{"NodeID": name, "Alive": True, "Resources": {"CPU": 1.0}} for name in ("one", "two")]
    monkeypatch.setattr(ray, "nodes", lambda: every)
    nodes, one, two = Nodes(), Place("one", "alpha", 1), Place("two", "beta", 2)
    assert nodes.selector == {}
    for _ in range(MAX_STRIKES - 1):
        assert not nodes.strike(one, "full")
    nodes.clear(one)  # a task ended well there
    assert [nodes.strike(one, "full") for _ in range(MAX_STRIKES)] == [False] * (MAX_STRIKES - 1) + [True]
    assert nodes.selector == {"ray.io/node-id": "!in(one)"}
    assert capsys.readouterr().err == "node alpha (one) is set aside, the others go on: full\n"
    assert not nodes.set_aside(two, "no torch")
    assert nodes.selector == {"ray.io/node-id": "!in(one)"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "reason"),
    [("unfit", "No module named 'sapien'"), ("full", r"OSError: \[Errno 28\] no space left")],
)
def test_a_node_that_lacks_a_package_or_whose_disk_is_full_is_set_aside_and_the_others_finish(
    two_nodes, tmp_path, capsys, monkeypatch, fault, reason
):
    def set_aside_and_tell(*arguments):
        (tmp_path / "set aside").touch()
        return set_aside(*arguments)

    address, bad = two_nodes
    set_aside = Nodes.set_aside
    monkeypatch.setattr(Nodes, "set_aside", set_aside_and_tell)
    (tmp_path / fault).write_text(bad)
    results = {}
    run_all(Choosy, Here(tmp_path), range(40), results.__setitem__, 2, address=address, max_faults=20)
    assert results == {i: 2 * i for i in range(40)}
    told = [line for line in capsys.readouterr().err.splitlines() if "set aside" in line]
    assert len(told) == 1
    assert re.match(rf"node \S+ \({bad[:12]}\) is set aside, the others go on: {reason}", told[0])


class Planning:
    """Adds up what its planner actors find; a planner of task 1 stops once."""

    def __init__(self, shared):
        self.folder, self.map = shared.folder, lambda function, arguments: list(map(function, arguments))
        if shared.planners > 1:
            from cutgrammar_workers.planner_pool import PlannerPool

            self.map = PlannerPool(shared.planners)

    def __call__(self, task):
        return sum(self.map(partial(found, task=task, folder=str(self.folder)), [0, 1]))


def found(number, task, folder):
    stopped = Path(folder) / "stopped"
    if task == number == 1 and not stopped.exists():
        stopped.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGSTOP)
    return 10 * task + number


@pytest.mark.slow
def test_a_planner_actor_that_is_stopped_costs_one_attempt_of_one_task_and_does_not_stay(tmp_path):
    results, shared = {}, Here(tmp_path, planners=2)
    run_all(Planning, shared, range(4), results.__setitem__, 2, planners=2, max_seconds=15.0)
    assert results == {i: 20 * i + 1 for i in range(4)}
    stopped = int((tmp_path / "stopped").read_text())
    for _ in range(100):
        if not is_alive(stopped):
            return
        time.sleep(0.1)
    pytest.fail("the stopped planner is still there")


def is_alive(process):
    try:
        return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except FileNotFoundError:
        return False
