"""The Ray that a run starts for itself."""

import os
import signal
import time

import psutil
import pytest
import ray

from cutgrammar_workers import lifeline
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.ray_session import session


class Sockets:
    """Tells where the processes of this run listen."""

    def __init__(self, driver):
        self.driver = driver

    def __call__(self, _):
        driver = psutil.Process(self.driver)
        found = {}
        for process in (driver, *driver.children(recursive=True), psutil.Process()):
            listening = [one for one in process.net_connections("tcp") if one.status == psutil.CONN_LISTEN]
            found[process.pid, process.name()] = {one.laddr.ip for one in listening}
        return found


@pytest.mark.slow
def test_a_local_run_listens_on_loopback_only():
    found = []
    run_all(Sockets, os.getpid(), [None], lambda _, result: found.append(result), 1)
    assert set().union(*found[0].values()) <= {"127.0.0.1", "::ffff:127.0.0.1", "::1"}, found


class NodeKiller:
    """Kills the node that it runs on."""

    def __init__(self, _):
        pass

    def __call__(self, _):
        raylet = next(process for process in psutil.Process().parents() if process.name() == "raylet")
        raylet.kill()
        time.sleep(600)


@pytest.mark.slow
def test_the_death_of_its_own_node_ends_a_run_with_one_line(capfd):
    with pytest.raises(ConnectionError, match=r"the Ray cluster's own node at 127\.0\.0\.1:\d+ has not answered for"):
        run_all(NodeKiller, None, [None], print, 1)
    said = capfd.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err


def test_a_ray_that_never_starts_is_given_up_with_one_line(monkeypatch):
    monkeypatch.setattr("ray.init", lambda **_: time.sleep(60.0))
    monkeypatch.setattr(lifeline, "START_SECONDS", 0.3)
    monkeypatch.setattr(lifeline, "CHECK_SECONDS", 0.1)
    with pytest.raises(ConnectionError, match=r"^Ray has not started within 0 s, .* \(--workers 0 needs no Ray\)$"):
        run_all(NodeKiller, None, [None], print, 1)


@pytest.mark.slow
def test_a_ray_that_cannot_be_started_is_one_line(monkeypatch):
    def init(**_):
        raise Exception("the raylet failed to start\nand more")  # as Ray does

    monkeypatch.setattr("ray.init", init)
    with pytest.raises(
        ConnectionError, match=r"could not be started \(the raylet failed to start\); see whether --wor"
    ):
        run_all(NodeKiller, None, [None], print, 1)


@pytest.mark.slow
def test_sigterm_is_handled_after_a_session_as_before():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda *_: heard.append("SIGTERM"))
    try:
        with session(1):
            pass
        os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == ["SIGTERM"]


@pytest.mark.slow
def test_a_slow_end_of_a_session_is_no_death(monkeypatch):
    def end_slowly():
        end()
        time.sleep(2.0)

    end = ray.shutdown
    monkeypatch.setattr(lifeline, "CHECK_SECONDS", 0.1)
    monkeypatch.setattr(lifeline, "MAX_SILENT_SECONDS", {"head": 0.5, "own node": 0.5})
    monkeypatch.setattr("ray.shutdown", end_slowly)
    began = time.monotonic()
    with session(1):
        pass
    assert time.monotonic() - began > 2.0  # it was slow, and nothing was raised
    assert not ray.is_initialized()
