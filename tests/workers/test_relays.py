"""News reach a relay; one that is stuck, broken or cannot be made neither blocks nor raises."""

import time
from pathlib import Path

import pytest

import relay_targets
from cutgrammar.trials.news import TrialSaved
from cutgrammar_workers.relays import relay

NEWS = [TrialSaved(f"trial {i}", "halve", "done", 0.5) for i in range(200)]
WORKERS = [0, pytest.param(1, marks=pytest.mark.slow)]


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
