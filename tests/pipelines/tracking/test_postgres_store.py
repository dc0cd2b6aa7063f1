"""An MLflow server on a PostgreSQL, both killed while a run is logged: `sync` completes it, each run once."""

import contextlib
import os
import pwd
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest
from tests.support.ray_head import free_port

from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.tracking import mlflow_store
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, log_runs, open_store
from cutgrammar_pipelines.tracking.run_log import RunLog, Study

INITDB = shutil.which("initdb") or next(map(str, sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))), "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not INITDB, reason="needs PostgreSQL: apt-get install postgresql"),
    pytest.mark.skipif(find_spec("psycopg2") is None, reason="needs psycopg2: pip install psycopg2-binary"),
]


class Servers:
    """A PostgreSQL, and an MLflow server on it; each may be killed and started again."""

    def __init__(self, folder):
        self.data, self.artifacts, self.running = folder / "data", folder / "artifacts", []
        self.database = f"postgresql+psycopg2://postgres@/postgres?host={self.data}"
        self.programs = Path(INITDB).resolve().parent
        self.user = {}
        if os.getuid() == 0:  # PostgreSQL refuses to be run by root
            nobody = pwd.getpwnam("nobody")
            self.user = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
            os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        command = [self.programs / "initdb", "-D", self.data, "-U", "postgres", "-A", "trust", "-N"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=folder, **self.user)

    def start(self):
        """Start both; returns the address of MLflow's server, which has a new port each time."""
        (self.data / "postmaster.pid").unlink(missing_ok=True)
        # By a socket in its folder; without fsync, which only matters to those who lose power.
        self._run([self.programs / "postgres", "-D", self.data, "-k", self.data, "-h", "", "-F"], **self.user)
        ready = [self.programs / "pg_isready", "-q", "-h", self.data]
        self._wait(lambda: subprocess.run(ready, check=False).returncode == 0)
        where = ["--backend-store-uri", self.database, "--artifacts-destination", self.artifacts, "--workers", "1"]
        port = free_port()
        # Its runners of jobs, which nobody asks for, are seven processes.
        environment = {**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
        self._run([sys.executable, "-m", "mlflow", "server", *where, "--port", port], env=environment)
        self._wait(lambda: answers(f"http://127.0.0.1:{port}/health"))
        return f"http://127.0.0.1:{port}"

    def kill(self):
        """SIGKILL to both, with all their processes."""
        for server in self.running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(server.pid, signal.SIGKILL)
            server.wait()
        self.running.clear()
        time.sleep(1.0)  # children of PostgreSQL lead sessions of their own and leave when it is gone

    @contextlib.contextmanager
    def stopped(self):
        """A block in which the PostgreSQL is stopped, with all that it has started."""
        leader = psutil.Process(self.running[0].pid)
        processes = [leader, *leader.children(recursive=True)]
        for process in processes:
            process.suspend()
        try:
            yield
        finally:
            for process in processes:
                process.resume()

    def _run(self, command, **how):
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        server = subprocess.Popen([str(part) for part in command], start_new_session=True, cwd="/", **quiet, **how)
        self.running.append(server)

    def _wait(self, is_ready):
        while not is_ready():
            assert all(server.poll() is None for server in self.running), "a server has ended"
            time.sleep(0.2)


def answers(address):
    with contextlib.suppress(OSError), urllib.request.urlopen(address, timeout=5):
        return True
    return False


@pytest.fixture
def servers():
    with tempfile.TemporaryDirectory() as folder:  # whose name is short enough for a socket
        servers = Servers(Path(folder))
        try:
            yield servers
        finally:
            servers.kill()


def logged():
    """Every run of the store: name, status, metrics, parameters."""
    client = open_store().client
    experiments = [one.experiment_id for one in client.search_experiments()]
    runs = client.search_runs(experiments, max_results=1000)
    return by_name((run.info.run_name, run.info.status, run.data.metrics, run.data.params) for run in runs)


def planned(logs):
    """What the store must show of these logs."""
    for log in logs:
        yield log.name, "FINISHED", dict(log.metrics), {name: str(value) for name, value in log.params.items()}
        yield from planned(log.children)


def by_name(runs):
    return sorted(
        (name, status, sorted(metrics.items()), sorted(params.items())) for name, status, metrics, params in runs
    )


def test_a_run_is_complete_after_both_were_killed_twice(servers, scored_run, monkeypatch, capsys):
    from mlflow import MlflowClient

    report = build_report([scored_run])
    expected = by_name(planned(evaluation_logs(scored_run, report)))
    assert len(expected) > 2
    monkeypatch.setenv("MLFLOW_TRACKING_URI", servers.start())
    log_batch = MlflowClient.log_batch
    for batch in (1, 2):  # in the first run's first batch, and after another was logged
        calls = []

        def fatal(self, *values, calls=calls, batch=batch, **more):
            calls.append(1)
            if len(calls) == batch:
                servers.kill()
            return log_batch(self, *values, **more)

        with monkeypatch.context() as patch:
            patch.setattr(MlflowClient, "log_batch", fatal)
            assert not log_evaluation(scored_run, report)
        assert "complete without it" in capsys.readouterr().err
        monkeypatch.setenv("MLFLOW_TRACKING_URI", servers.start())
        assert logged() != expected
    subprocess.run([sys.executable, "-m", "cutgrammar_pipelines", "sync", scored_run], check=True)
    assert logged() == expected

    # Without the server: a PostgreSQL that is stopped in the middle of a request.
    monkeypatch.setenv("MLFLOW_TRACKING_URI", servers.database)
    monkeypatch.setattr(mlflow_store, "MAX_SECONDS", 5.0)
    create_run = MlflowClient.create_run

    def hang(self, *values, **more):
        with servers.stopped():
            return create_run(self, *values, **more)

    monkeypatch.setattr(MlflowClient, "create_run", hang)
    assert not log_runs(Study("another", "d"), [RunLog("one", {"x": 1})], "later")
    assert "it has not answered for 5 s" in capsys.readouterr().err
