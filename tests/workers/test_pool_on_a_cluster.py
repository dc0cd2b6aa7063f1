"""Tasks on a cluster that is not there, loses a node or its head, or has a node where workers hang."""

import re
import threading

import pytest

import hanging_doubler
from cutgrammar.errors import InputError
from cutgrammar_workers.nodes import Nodes
from cutgrammar_workers.pool import run_all
from hanging_doubler import Doubler, Shared
from squarer import Squarer, Task, results_of


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


@pytest.mark.slow
def test_a_node_where_workers_hang_is_set_aside_and_the_others_finish(tmp_path, capsys, monkeypatch):
    def set_aside_and_tell(*arguments):
        (tmp_path / "set aside").touch()
        return set_aside(*arguments)

    set_aside = Nodes.set_aside
    monkeypatch.setattr(Nodes, "set_aside", set_aside_and_tell)
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    cluster, results = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}), {}
    try:
        bad = cluster.head_node.node_id
        (tmp_path / "good").write_text(cluster.add_node(num_cpus=1).node_id)
        shared = Shared(tmp_path, "sleep")
        run_all(Doubler, shared, range(9), results.__setitem__, 2, address=cluster.address, max_start_seconds=2.0)
    finally:
        cluster.shutdown()
    assert results == {i: 2 * i for i in range(9)}
    (told,) = (line for line in capsys.readouterr().err.splitlines() if "set aside" in line)
    where = (
        rf"the others go on: a worker was not built within 2 s, and was at {re.escape(hanging_doubler.__file__)}:\d+$"
    )
    assert re.match(rf"node \S+ \({bad[:12]}\) is set aside, {where}", told)
    assert len(list(tmp_path.glob("built-*"))) == 2
