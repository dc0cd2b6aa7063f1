"""The client of MLflow: the driver logs in batches, and logging twice changes nothing.

The store is `MLFLOW_TRACKING_URI`, or `mlflow.db` in the current folder with its artifacts beside it. Results never
depend on it: if it does not answer, one line says so and the caller continues; `cutgrammar sync RUN` logs them later.
"""

import contextlib
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from cutgrammar.errors import InputError
from cutgrammar.results.report import Report
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from cutgrammar_pipelines.tracking.run_log import RunLog
from cutgrammar_pipelines.tracking.training_logs import training_logs

if TYPE_CHECKING:
    from cutgrammar_pipelines.stages.train import Trained

TRAINING, EVALUATION, ABLATIONS = "cutgrammar training", "cutgrammar evaluation", "cutgrammar ablations"
"""Names of the experiments."""
KEY, CONTENT = "cutgrammar.key", "cutgrammar.content"
"""Tags of a run: the digest of its identity and, when it is complete, that of its content."""
BATCH = {"metrics": 1000, "params": 100}
"""Maximum numbers of entities in one request."""
MAX_PARAM_LENGTH = 6000
MAX_DIGEST_LENGTH = 36
ENVIRONMENT = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "3",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "1",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_ALLOW_PICKLE_DESERIALIZATION": "false",
    "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
}
"""Detect a dead server in seconds, not minutes, and send no telemetry; values that the user has set take precedence."""


@dataclass(frozen=True)
class Store:
    """An open store.

    Attributes:
        client: of MLflow.
        uri: of the store.
    """

    client: Any
    uri: str

    def experiment(self, name: str) -> str:
        """Id of the experiment, which is created if it does not exist."""
        experiment = self.client.get_experiment_by_name(name)
        if experiment is not None:
            return str(experiment.experiment_id)
        local = not self.uri.startswith(("http://", "https://"))
        artifacts = (_folder(self.uri) / "mlartifacts" / name.replace(" ", "-")).as_uri() if local else None
        return str(self.client.create_experiment(name, artifact_location=artifacts))


def store_uri() -> str:
    """The address of the store: `MLFLOW_TRACKING_URI`, or a database in the current folder."""
    return os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{Path('mlflow.db').resolve()}"


def store_name() -> str:
    """The store as it may be shown: without a password."""
    uri = store_uri()
    parts = urlsplit(uri)
    return uri.replace(f"{parts.username or ''}:{parts.password}@", "...@") if parts.password else uri


def open_store() -> Store:
    """Open the store; MLflow takes seconds to import, so nothing else here imports it.

    Raises:
        one of `failures()`: it does not answer.
    """
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    import mlflow.store.db.utils as database
    from mlflow import MlflowClient

    for name in ("mlflow", "alembic"):
        logging.getLogger(name).setLevel(logging.ERROR)
    database.MAX_RETRY_COUNT = 2  # its ten tries take two minutes
    return Store(MlflowClient(tracking_uri=store_uri(), registry_uri=store_uri()), store_uri())


def failures() -> tuple[type[Exception], ...]:
    """The exceptions of a store that does not answer, is torn or cannot be written."""
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    return MlflowException, SQLAlchemyError, OSError, ImportError


def log_training(trained: "Trained", data: Path) -> bool:
    """Log a training, one run a part; False and a one-line warning if MLflow does not answer.

    Args:
        trained: the result of `train`.
        data: folder of the data set.
    """
    advice = f"the model in {trained.path} is complete without it; the same cutgrammar train logs it later"
    return _log(TRAINING, training_logs(trained.path, trained.model, trained.learned, data), advice)


def log_evaluation(run: Path, report: Report, files: Sequence[Path] = ()) -> bool:
    """Log an evaluation; False and a one-line warning if MLflow does not answer.

    Args:
        run: the run folder.
        report: of this run folder alone.
        files: further artifacts, e.g. the report as a page.

    Raises:
        InputError: the run folder cannot be read.
    """
    advice = f"the results in {run} are complete without it; cutgrammar sync {run} logs it later"
    return _log(EVALUATION, evaluation_logs(run, report, files), advice)


def log_ablations(log: RunLog, out: Path) -> bool:
    """Log the summary of a study's variants; False and a one-line warning if MLflow does not answer.

    Args:
        log: the summary (see `ablations.summary_log`).
        out: the study's folder.
    """
    return _log(ABLATIONS, [log], f"the summary in {out} is complete without it; the same study logs it later")


def serve(port: int) -> int:
    """Start MLflow's page on the store, on this machine only, until it is stopped; return its exit code.

    Raises:
        InputError: there is no store yet, or the port is taken.
    """
    uri = store_uri()
    if uri.startswith(("http://", "https://")):
        print(f"MLflow's page is at {store_name()}")
        return 0
    if uri.startswith("sqlite:///") and not Path(uri.removeprefix("sqlite:///")).exists():
        raise InputError(f"there is no store {store_name()} yet; train or evaluate creates one in the current folder")
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port that was closed just now is free
        try:
            trial.bind(("127.0.0.1", port))
        except (OSError, OverflowError):
            raise InputError(f"port {port} cannot be used on this machine; try --port {port % 60000 + 1}") from None
    print(f"MLflow's page for {store_name()} will be at http://127.0.0.1:{port} in half a minute; Ctrl-C stops it")
    command = ["server", "--backend-store-uri", uri, "--default-artifact-root", str(_folder(uri) / "mlartifacts")]
    command += ["--host", "127.0.0.1", "--port", str(port), "--workers", "1"]
    environment = ENVIRONMENT | dict(os.environ)
    # In a session of its own, so that Ctrl-C reaches only this process, which then ends the server quietly.
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, _leave)
    server = subprocess.Popen([sys.executable, "-m", "mlflow", *command], env=environment, start_new_session=True)
    try:
        return server.wait()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, signal.SIGTERM)
        server.wait()


def _leave(number: int, _: object) -> None:
    """End this process so that its server is stopped, too."""
    sys.exit(128 + number)


def _log(experiment: str, logs: Sequence[RunLog], advice: str) -> bool:
    """Log runs to an experiment; False and a one-line warning, which ends with `advice`, if MLflow does not answer."""
    try:
        store = open_store()
        experiment_id = store.experiment(experiment)
        for log in logs:
            _log_run(store.client, experiment_id, log, None)
    except failures() as error:
        reason = (str(error) or type(error).__name__).splitlines()[0][:200]
        print(f"warning: MLflow at {store_name()} cannot be used ({reason}); {advice}", file=sys.stderr)
        return False
    return True


def _log_run(client: Any, experiment: str, log: RunLog, parent: str | None) -> None:
    """Create or update the run with this identity, and its children."""
    runs = client.search_runs([experiment], filter_string=f"tags.`{KEY}` = '{log.key}'", max_results=1)
    if runs:
        run = runs[0]
    else:
        tags = {KEY: log.key} | ({"mlflow.parentRunId": parent} if parent else {})
        run = client.create_run(experiment, run_name=log.name, tags=tags)
    if run.data.tags.get(CONTENT) == log.content:
        return
    for child in log.children:
        _log_run(client, experiment, child, run.info.run_id)
    _log_content(client, run, log)
    client.set_tag(run.info.run_id, CONTENT, log.content)
    client.set_terminated(run.info.run_id)


def _log_content(client: Any, run: Any, log: RunLog) -> None:
    """Log everything that the run does not contain yet."""
    from mlflow.entities import Dataset, DatasetInput, InputTag, Metric, Param, RunTag

    run_id = run.info.run_id
    now = time.time_ns() // 1_000_000  # of two values with the same step, MLflow shows the later one
    metrics = [
        Metric(name, value, now, 0) for name, value in log.metrics.items() if run.data.metrics.get(name) != value
    ]
    for name, points in log.curves.items():
        known = {(point.step, point.value) for point in client.get_metric_history(run_id, name)}
        metrics += [Metric(name, value, now, step) for step, value in points if (step, value) not in known]
    params = [
        Param(name, str(value)[:MAX_PARAM_LENGTH]) for name, value in log.params.items() if name not in run.data.params
    ]
    for i in range(0, len(metrics), BATCH["metrics"]):
        client.log_batch(run_id, metrics=metrics[i : i + BATCH["metrics"]])
    for i in range(0, len(params), BATCH["params"]):
        client.log_batch(run_id, params=params[i : i + BATCH["params"]])
    client.log_batch(run_id, tags=[RunTag(name, value) for name, value in log.tags.items()])
    known_inputs = {(known.dataset.name, known.dataset.digest) for known in getattr(run.inputs, "dataset_inputs", ())}
    inputs = [
        DatasetInput(
            Dataset(source.name, source.digest[:MAX_DIGEST_LENGTH], "local", json.dumps({"uri": source.path})),
            [InputTag("mlflow.data.context", source.context)],
        )
        for source in log.inputs
        if (source.name, source.digest[:MAX_DIGEST_LENGTH]) not in known_inputs
    ]
    if inputs:
        client.log_inputs(run_id, inputs)
    for name, text in log.texts.items():
        client.log_text(run_id, text, name)
    for file in log.files:
        client.log_artifact(run_id, str(file))


def _folder(uri: str) -> Path:
    """The folder of artifacts of a store without a server: that of its database."""
    return Path(uri.removeprefix("sqlite:///")).resolve().parent if uri.startswith("sqlite:///") else Path.cwd()
