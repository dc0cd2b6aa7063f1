"""A store that is sick in any way costs a run one line and half a minute, and never shows a password."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from tests.support.sick_servers import Busy, Closed, Confused, Dripping, Silent, Talkative, serving

from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.tracking import mlflow_store
from cutgrammar_pipelines.tracking import patience as limits
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, open_store
from cutgrammar_pipelines.tracking.patience import Patience

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

OPEN = "from cutgrammar_pipelines.tracking.mlflow_store import open_store; open_store()"


@pytest.mark.parametrize("kind", [Busy, Dripping, Silent, Closed, Talkative, Confused])
def test_a_sick_server_costs_one_line(kind, scored_run, monkeypatch, capsys):
    monkeypatch.setattr(mlflow_store, "MAX_SECONDS", 4.0)
    report = build_report([scored_run])
    with serving(kind) as port:
        monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://user:s3cr%3At@127.0.0.1:{port}")
        assert not log_evaluation(scored_run, report)
    told = capsys.readouterr().err
    assert "cannot be used" in told.splitlines()[-1]
    assert "s3cr" not in told


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("MLFLOW_TRACKING_URI", "http://[::1"),
        ("MLFLOW_TRACKING_URI", "http://127.0.0.1:99999"),
        ("MLFLOW_TRACKING_URI", "http://user:s3cret@no.such.host.invalid"),
        ("MLFLOW_TRACKING_URI", "mysql+nothing://user:s3cret@127.0.0.1/x"),
        ("MLFLOW_HTTP_REQUEST_TIMEOUT", "soon"),
        ("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "many"),
    ],
)
def test_a_malformed_environment_is_one_line(name, value, scored_run, monkeypatch, capsys):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    monkeypatch.setenv(name, value)
    assert not log_evaluation(scored_run, build_report([scored_run]))
    told = capsys.readouterr().err
    assert "cannot be used" in told.splitlines()[-1]
    assert "s3cret" not in told


def test_the_limit_is_that_of_one_request():
    patience = Patience(1.0)
    for _ in range(4):
        with patience.request():
            time.sleep(0.5)
    time.sleep(1.2)  # work between requests does not count
    with pytest.raises(TimeoutError, match=r"not answered for 1 s$"), patience.request():
        time.sleep(30)
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


def test_requests_that_are_all_slow_share_a_limit(monkeypatch):
    monkeypatch.setattr(limits, "QUICK_SECONDS", 0.1)
    patience, answered = Patience(5.0, waiting=0.5), []

    def ask_ten_times():
        for _ in range(10):
            with patience.request():
                time.sleep(0.3)
            answered.append(True)

    with pytest.raises(TimeoutError, match="after other requests that took long"):
        ask_ten_times()
    assert 1 <= len(answered) <= 2


def test_a_stop_that_is_swallowed_is_repeated(monkeypatch):
    monkeypatch.setattr(limits, "REPEAT_SECONDS", 0.2)

    def swallow():
        with contextlib.suppress(BaseException):
            time.sleep(30)
        time.sleep(30)

    with pytest.raises(TimeoutError), Patience(0.2).request():
        swallow()


def test_four_first_users_at_once_make_one_store(tmp_path):
    environment = {**os.environ, "MLFLOW_TRACKING_URI": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    users = [subprocess.Popen([sys.executable, "-c", OPEN], env=environment) for _ in range(4)]
    assert [user.wait() for user in users] == [0, 0, 0, 0]


def test_a_first_user_who_is_killed_leaves_a_store_that_can_be_made(tmp_path, scored_run, monkeypatch, capsys):
    database = tmp_path / "mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{database}")
    rng = random.Random(0)
    for _ in range(3):
        user = subprocess.Popen([sys.executable, "-c", OPEN])
        while user.poll() is None and not database.with_name("mlflow.db.new").exists():
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 1.0))
        user.kill()
        user.wait()
    open_store()
    assert log_evaluation(scored_run, build_report([scored_run])), capsys.readouterr().err
