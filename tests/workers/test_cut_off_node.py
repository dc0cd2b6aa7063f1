"""A node whose cable is unplugged while it works, in network namespaces."""

import os
import shutil
import subprocess
import sys

import pytest

from cutgrammar_workers import nodes as nodes_module
from cutgrammar_workers.nodes import Nodes
from cutgrammar_workers.worker_actor import Place
from measures.namespaces import PORT, nodes, start

SLOW = """
import time


class Slow:
    def __init__(self, shared):
        pass

    def __call__(self, task):
        time.sleep(0.5)
        return 2 * task
"""
DRIVER = """
import sys

from cutgrammar_workers.pool import run_all
from slow import Slow

say = lambda index, result: print(index, result, flush=True)
run_all(Slow, None, range(24), say, 2, address=sys.argv[1], max_seconds=8.0)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("ip") is None, reason="network namespaces need root and iproute2")
def test_a_node_that_is_cut_off_costs_no_result_and_is_named(tmp_path):
    (tmp_path / "slow.py").write_text(SLOW)
    results = {}
    with nodes(2, 1, tmp_path, network=40 + os.getpid() % 60) as cluster:
        for node in cluster:
            node.environment = {**node.environment, "PYTHONPATH": str(tmp_path)}
        start(cluster)
        words = [sys.executable, "-c", DRIVER, f"{cluster[0].address}:{PORT}"]
        driver = cluster[0].run(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for line in driver.stdout:
            index, result = map(int, line.split())  # a TimedOut or Crashed is no number
            assert index not in results
            results[index] = result
            if len(results) == 8:  # both nodes have work in flight
                cluster[1].cut_off()
        said = driver.communicate()[1]
        assert driver.returncode == 0, said
    assert results == {index: 2 * index for index in range(24)}
    assert f"at {cluster[1].address} (" in said
    assert said.count(": its tasks are repeated") == 1, said


def test_a_node_that_does_not_answer_is_told_once_until_it_works_again(monkeypatch, capsys):
    facts = {"NodeID": "one", "NodeManagerAddress": "10.0.0.1", "NodeManagerPort": 1}
    answers = iter([True, False, False])  # it is not asked again at once
    monkeypatch.setattr(nodes_module.ray, "nodes", lambda: [facts])
    monkeypatch.setattr(nodes_module, "is_listening", lambda _: next(answers))
    found, place = Nodes(), Place("one", "alpha", 7)
    assert [found.is_cut_off(place) for _ in range(3)] == [False, True, True]
    assert capsys.readouterr().err == "node alpha at 10.0.0.1 (one) does not answer: its tasks are repeated\n"
    found.clear(place)
    assert found.is_cut_off(place)
    assert "does not answer" in capsys.readouterr().err
    assert not found.is_cut_off(Place("another", "beta", 8))  # Ray does not know it
