"""Runs are logged beside a server: when asked to, and what was asked for before it ends."""

import threading
from pathlib import Path

import pytest

from cutgrammar_pipelines.tracking import later_sync
from cutgrammar_pipelines.tracking.later_sync import LaterSync

RUNS = [Path("one"), Path("two")]


@pytest.fixture
def commands(monkeypatch):
    started = []
    monkeypatch.setattr(later_sync.subprocess, "run", lambda command, **_: started.append(command[-2:]))
    return started


def test_every_run_is_logged_when_asked_to_and_before_the_end(commands):
    with LaterSync([*RUNS, RUNS[0]]) as sync:
        sync.request()
    assert commands == [["sync", "one"], ["sync", "two"]]


def test_without_a_request_nothing_is_logged(commands):
    with LaterSync(RUNS):
        pass
    assert commands == []


def test_requests_that_wait_are_one(monkeypatch):
    started, begun, go = [], threading.Event(), threading.Event()

    def run(command, **_):
        started.append(command[-1])
        begun.set()
        go.wait(10)

    monkeypatch.setattr(later_sync.subprocess, "run", run)
    with LaterSync(RUNS[:1]) as sync:
        sync.request()
        assert begun.wait(10)
        for _ in range(5):
            sync.request()
        go.set()
    assert started == ["one", "one"]
