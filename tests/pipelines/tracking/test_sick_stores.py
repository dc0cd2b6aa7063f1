"""A store that is sick in any way costs a run one line and half a minute, and never shows a password."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.tracking import mlflow_store
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, open_store
from cutgrammar_pipelines.tracking.patience import patience

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

OPEN = "from cutgrammar_pipelines.tracking.mlflow_store import open_store; open_store()"


class Sick(BaseHTTPRequestHandler):
    """Answers every request in the way of its class."""

    protocol_version = "HTTP/1.1"

    def do_GET(self):
        self.answer()

    do_POST = do_GET

    def log_message(self, *_):
        pass

    def say(self, status, body=b"{}", **headers):
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


class Busy(Sick):
    def answer(self):
        self.say(429, Retry_After="3600")


class Dripping(Sick):
    def answer(self):
        self.send_response(200)
        self.send_header("Content-Length", "1000000")
        self.end_headers()
        with contextlib.suppress(OSError):
            for _ in range(600):
                self.wfile.write(b" ")
                time.sleep(0.2)


class Silent(Sick):
    def answer(self):
        time.sleep(120)


class Closed(Sick):
    def answer(self):
        self.say(401, b"who are you?")


class Talkative(Sick):
    """Repeats the password, in several lines."""

    def answer(self):
        self.say(500, b'{"error_code": "INTERNAL_ERROR", "message": "user:s3cr%3At and s3cr:t\\nare wrong"}')


@contextlib.contextmanager
def serving(kind):
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()


@pytest.mark.parametrize("kind", [Busy, Dripping, Silent, Closed, Talkative])
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


def test_the_limit_restarts_with_every_request():
    with patience(1.0) as restart:
        for _ in range(4):
            restart()
            time.sleep(0.5)
    with pytest.raises(TimeoutError, match="not answered for 1 s"), patience(1.0):
        time.sleep(30)
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


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
