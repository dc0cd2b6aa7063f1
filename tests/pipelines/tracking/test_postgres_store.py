"""An MLflow server on a PostgreSQL, both killed while a run is logged: `sync` completes it, each run once."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import pytest
from tests.support.ray_head import free_port

from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, open_store

pytest.importorskip("psycopg2", reason="MLflow's server reaches PostgreSQL by it")
INITDB = shutil.which("initdb") or next(map(str, sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))), "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not INITDB, reason="needs PostgreSQL"),
]


class Servers:
    """A PostgreSQL, and an MLflow server on it; each may be killed and started again."""

    def __init__(self, folder):
        self.data, self.port, self.database_port = folder / "data", free_port(), free_port()
        self.artifacts, self.running = folder / "artifacts", []
        self.programs = Path(INITDB).resolve().parent
        # PostgreSQL refuses to be run by root.
        self.user = {"user": "postgres", "group": "postgres", "extra_groups": []} if os.getuid() == 0 else {}
        if self.user:
            shutil.chown(folder, "postgres", "postgres")
        command = [self.programs / "initdb", "-D", self.data, "-U", "postgres", "-A", "trust", "-N"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=folder, **self.user)

    def start(self):
        (self.data / "postmaster.pid").unlink(missing_ok=True)
        ports = ["-p", str(self.database_port), "-k", str(self.data), "-h", "127.0.0.1"]
        self._run([self.programs / "postgres", "-D", self.data, *ports], **self.user)
        ready = [self.programs / "pg_isready", "-q", "-h", "127.0.0.1", "-p", str(self.database_port)]
        self._wait(lambda: subprocess.run(ready, check=False).returncode == 0)
        store = f"postgresql+psycopg2://postgres@127.0.0.1:{self.database_port}/postgres"
        where = ["--backend-store-uri", store, "--artifacts-destination", str(self.artifacts), "--workers", "1"]
        self._run([sys.executable, "-m", "mlflow", "server", *where, "--port", str(self.port)])
        self._wait(self._answers)

    def kill(self):
        """SIGKILL to both, with all their processes."""
        for server in self.running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(server.pid, signal.SIGKILL)
            server.wait()
        self.running.clear()
        time.sleep(1.0)  # children of PostgreSQL lead sessions of their own and leave when it is gone

    def _run(self, command, **how):
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        server = subprocess.Popen([str(part) for part in command], start_new_session=True, cwd="/", **quiet, **how)
        self.running.append(server)

    def _wait(self, is_ready):
        while not is_ready():
            assert all(server.poll() is None for server in self.running), "a server has ended"
            time.sleep(0.5)

    def _answers(self):
        with contextlib.suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{self.port}/health", timeout=5):
            return True
        return False


@pytest.fixture
def servers():
    with tempfile.TemporaryDirectory() as folder:
        servers = Servers(Path(folder))
        try:
            servers.start()
            yield servers
        finally:
            servers.kill()


def logged():
    """Every run of the store by its name: whether it is complete, metrics and parameters."""
    client = open_store().client
    experiments = [one.experiment_id for one in client.search_experiments()]
    runs = client.search_runs(experiments, max_results=1000)
    return sorted((run.info.run_name, run.info.status, run.data.metrics, run.data.params) for run in runs)


def test_a_run_is_complete_after_both_were_killed_twice(servers, scored_run, monkeypatch, capsys, tmp_path):
    from mlflow import MlflowClient

    report = build_report([scored_run])
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    assert log_evaluation(scored_run, report)
    expected = logged()
    assert len(expected) > 2

    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{servers.port}")
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
        servers.start()
        assert logged() != expected
    subprocess.run([sys.executable, "-m", "cutgrammar_pipelines", "sync", scored_run], check=True)
    assert logged() == expected
