"""News reach a relay; one that is stuck, broken or cannot be made neither blocks nor raises."""

import time
from pathlib import Path

import pytest

import relay_targets
from cutgrammar.trials.news import TrialSaved
from cutgrammar_workers import relays
from cutgrammar_workers.relays import CLOSE_SECONDS, patience, relay

NEWS = [TrialSaved(f"trial {i}", "halve", "done", 0.5) for i in range(200)]
WORKERS = [0, pytest.param(1, marks=pytest.mark.slow)]


@pytest.fixture
def patient(monkeypatch):
    """Relays have as long as they need to show what is left, however busy this machine is."""
    monkeypatch.setattr(relays, "CLOSE_SECONDS", 60.0)
    monkeypatch.setattr(relays, "LEAST_CLOSE_SECONDS", 60.0)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("workers", WORKERS)
def test_news_reach_the_relay_in_order_and_it_is_closed_at_the_end(tmp_path, workers, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(relay_targets.__file__).parent))  # for the processes of Ray
    file = tmp_path / "told"
    with relay("relay_targets:Collector", (str(file),), workers) as outlet:
        for news in NEWS[:3]:
            outlet(news)
        deadline = time.monotonic() + 60
        while not (file.exists() and file.read_text().count("\n") == 3) and time.monotonic() < deadline:
            time.sleep(0.05)
    assert file.read_text().split("\n") == ["trial 0", "trial 1", "trial 2", "closed", ""]


@pytest.mark.parametrize("workers", WORKERS)
@pytest.mark.parametrize("target", ["relay_targets:Stuck", "relay_targets:Broken", "relay_targets:NoSuchThing"])
def test_a_relay_that_is_stuck_broken_or_missing_costs_next_to_nothing(target, workers):
    with relay(target, (), workers) as outlet:
        began = time.perf_counter()
        for news in NEWS:
            outlet(news)
        told = time.perf_counter() - began
        ending = time.perf_counter()
    assert told / len(NEWS) < 0.1  # it did not wait for what takes ten minutes
    assert time.perf_counter() - ending < 60


def test_a_relay_that_is_slow_to_start_shows_as_many_news_as_may_wait(tmp_path):
    file = tmp_path / "told"
    with relay("relay_targets:Collector", (str(file),), 0, max_waiting=len(NEWS)) as outlet:
        for news in NEWS:  # the process has not even begun
            outlet(news)
        deadline = time.monotonic() + 60
        while not (file.exists() and file.read_text().count("\n") == len(NEWS)) and time.monotonic() < deadline:
            time.sleep(0.05)
    assert file.read_text().split("\n")[: len(NEWS)] == [news.title for news in NEWS]


@pytest.mark.slow
@pytest.mark.usefixtures("patient")
def test_news_from_every_node_of_a_cluster_reach_one_relay(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(relay_targets.__file__).parent))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    import ray
    from ray.cluster_utils import Cluster

    def tell(outlet, name):
        outlet(TrialSaved(name, "halve", "done", 0.5))
        return ray.get_runtime_context().get_node_id()

    file, names = tmp_path / "told", ["first", "second"]
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "resources": {"first": 1}})
    try:
        cluster.add_node(num_cpus=1, resources={"second": 1})
        with relay("relay_targets:Collector", (str(file),), 2, cluster.address) as outlet:
            tasks = [ray.remote(tell).options(resources={name: 1}).remote(outlet, name) for name in names]
            nodes = ray.get(tasks)
            deadline = time.monotonic() + 60
            while not (file.exists() and file.read_text().count("\n") == 2) and time.monotonic() < deadline:
                time.sleep(0.05)
    finally:
        cluster.shutdown()
    assert len(set(nodes)) == 2
    assert sorted(file.read_text().split()) == ["closed", *names]


def test_the_end_of_a_run_waits_a_small_share_of_its_time_for_a_relay():
    assert patience(0.0) > 0.0
    assert patience(20.0) < 0.05 * 20.0
    assert patience(1e6) == CLOSE_SECONDS
