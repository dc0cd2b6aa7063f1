"""The client of MLflow: the driver logs in batches, and logging twice changes nothing.

The store is `MLFLOW_TRACKING_URI`, or `mlflow.db` in the current folder with its artifacts beside it. Results never
depend on it: if it does not answer, one line says so and the caller continues; `cutgrammar sync RUN` logs them later.
"""

import contextlib
import json
import logging
import os
import re
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from cutgrammar.command_lines import command_line
from cutgrammar.results.report import Report
from cutgrammar.storage.run_folder import read_run
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.tracking.chart_page import note, views
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from cutgrammar_pipelines.tracking.new_database import database_file, make_database, one_at_a_time
from cutgrammar_pipelines.tracking.patience import MAX_SECONDS, Patience, Timed
from cutgrammar_pipelines.tracking.run_log import KIND, METHOD, RunLog, Study
from cutgrammar_pipelines.tracking.training_logs import Curve, training_log

if TYPE_CHECKING:
    from cutgrammar_pipelines.stages.train import Trained

KEY, CONTENT = "cutgrammar.key", "cutgrammar.content"
"""Tags of a run: the digest of its identity and, when it is complete, that of its content."""
STUDY = "cutgrammar.study"
"""Tag of an experiment: the digest of its study."""
BATCH = {"metrics": 800, "params": 100}
"""Numbers of entities in one request; with a run's tags, of which there are fewer than 100, MLflow takes 1000."""
MAX_PARAM_LENGTH = 6000
MAX_DIGEST_LENGTH = 36
ENVIRONMENT = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "3",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "1",
    "PGCONNECT_TIMEOUT": "10",
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

    def experiment(self, study: Study) -> str:
        """Id of the study's experiment, which is created if it does not exist.

        A study of other data that has the name already keeps it; then the digest is added to the name.
        """
        for name in (study.name, f"{study.name} ({study.digest[:8]})"):
            experiment = self.client.get_experiment_by_name(name)
            if experiment is None:
                self._create(name, study)
                experiment = self.client.get_experiment_by_name(name)
            if experiment.tags.get(STUDY) == study.digest:
                return str(experiment.experiment_id)
        raise ConnectionError(f"its experiment {name!r} belongs to something else")

    def _create(self, name: str, study: Study) -> None:
        """Create an experiment, unless another process has created it meanwhile."""
        from mlflow.exceptions import MlflowException

        local = not self.uri.startswith(("http://", "https://"))
        artifacts = (store_folder(self.uri) / "mlartifacts" / name.replace(" ", "-")).as_uri() if local else None
        # Without its kind MLflow shows the page of an experiment as one of language models.
        tags = {STUDY: study.digest, "mlflow.experimentKind": "custom_model_development"}
        try:
            self.client.create_experiment(name, artifact_location=artifacts, tags=tags)
        except MlflowException as error:
            if error.error_code != "RESOURCE_ALREADY_EXISTS":
                raise


def store_uri() -> str:
    """The address of the store: `MLFLOW_TRACKING_URI`, or a database in the current folder."""
    return os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{Path('mlflow.db').resolve()}"


def store_name() -> str:
    """The store as it may be shown: without a password."""
    return without_password(store_uri())


def without_password(text: str) -> str:
    """A text without the name and password in the address of the store, which may be malformed."""
    text = re.sub(r"(password=)[^&\s]*", r"\1...", text)
    if not (password := _password(store_uri())):
        return text
    text = re.sub(r"[^/@\s]*:" + re.escape(password) + "@", "...@", text)
    return text.replace(password, "...").replace(unquote(password), "...")


def _password(uri: str) -> str | None:
    try:
        if found := urlsplit(uri).password:
            return found
    except ValueError:
        pass
    known = re.match(r"[^:/]*://[^:/]*:(.*)@", uri)  # what no parser finds, such as one with a slash
    return known[1] if known else None


def open_store() -> Store:
    """Open the store; MLflow takes seconds to import, so nothing else here imports it.

    Raises:
        one of `failures()`: it does not answer.
    """
    _load()
    from mlflow import MlflowClient

    make_database(store_uri())
    return Store(MlflowClient(tracking_uri=store_uri(), registry_uri=store_uri()), store_uri())


def _load() -> None:
    """Import MLflow and set it up."""
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    import mlflow.store.db.utils as database

    for name in ("mlflow", "alembic"):
        logging.getLogger(name).setLevel(logging.ERROR)
    database.MAX_RETRY_COUNT = 2  # its ten tries take two minutes
    if store_uri().startswith("postgresql"):
        with contextlib.suppress(ImportError):
            import psycopg2.extensions
            import psycopg2.extras

            # It waits in Python, where the time limit can interrupt it, and not for ever in libpq.
            psycopg2.extensions.set_wait_callback(psycopg2.extras.wait_select)


def failures() -> tuple[type[Exception], ...]:
    """The exceptions of a store that does not answer, is torn or cannot be written, or of a malformed environment."""
    from google.protobuf.json_format import Error as NotMlflow
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    return MlflowException, SQLAlchemyError, OSError, ImportError, ValueError, NotMlflow


def log_training(
    trained: "Trained", data: str | Path, study: Study | None = None, history: Mapping[str, Curve] | None = None
) -> bool:
    """Log a training and register its model; False and a one-line warning if MLflow does not answer.

    Args:
        trained: the result of `train`.
        data: folder or URL of the data set.
        study: that it belongs to; by default that of the folder which holds the model's.
        history: the load of the machine (see `system_load`).
    """
    from cutgrammar_pipelines.inspection.pictures import pictures_of_model  # imports matplotlib and torch

    study = study or Study.around(trained.path, trained.model.provenance.data)
    advice = f"the model in {trained.path} is complete without it; the same {command_line('train')} logs it later"
    with tempfile.TemporaryDirectory() as folder:
        files = pictures_of_model(trained.path, Path(folder) / "grammar.png", data)
        log = training_log(trained.path, trained.model, trained.learned, data, files, history)
        return log_runs(study, [log], advice)


def log_evaluation(
    run: Path,
    report: Report,
    files: Sequence[Path] = (),
    study: Study | None = None,
    records: Sequence[Record] | None = None,
    *,
    is_patient: bool = False,
) -> bool:
    """Log an evaluation; False and a one-line warning if MLflow does not answer.

    Args:
        run: the run folder.
        report: of this run folder alone.
        files: further artifacts, e.g. the report as a page.
        study: that it belongs to; by default that of the folder which holds the run's.
        records: of the run, where they are read already.
        is_patient: a slow server may take its time, as long as every single request is answered.

    Raises:
        InputError: the run folder cannot be read.
    """
    study = study or Study.around(run, read_run(run).data_digest)
    advice = f"the results in {run} are complete without it; {command_line('sync', run)} logs it later"
    return log_runs(study, evaluation_logs(run, report, files, records), advice, is_patient=is_patient)


def log_ablations(log: RunLog, out: Path, study: Study) -> bool:
    """Log the summary of a study's variants; False and a one-line warning if MLflow does not answer.

    Args:
        log: the summary (see `ablations.summary_log`).
        out: the study's folder.
        study: the experiment of its variants.
    """
    return log_runs(study, [log], f"the summary in {out} is complete without it; the same study logs it later")


def log_runs(study: Study, logs: Sequence[RunLog], advice: str, *, is_patient: bool = True) -> bool:
    """Log the runs of a study; False and a one-line warning, which ends with `advice`, if MLflow does not answer."""
    try:
        _load()
        is_file = database_file(store_uri()) is not None  # never hangs, but can be slow on a busy disk
        patience = Patience(None if is_file else MAX_SECONDS, None if is_patient else MAX_SECONDS)
        with patience.request():
            store = open_store()
        store = replace(store, client=Timed(store.client, patience))
        with one_at_a_time(store.uri, MAX_SECONDS):
            experiment = store.experiment(study)
            for log in logs:
                _log_run(store.client, experiment, log, None)
                if log.model is not None:
                    _register(store.client, experiment, log)
            _set_views(store.client, experiment)
    except failures() as error:
        reason = without_password((str(error) or type(error).__name__).splitlines()[0][:200])
        print(f"warning: MLflow at {store_name()} cannot be used ({reason}); {advice}", file=sys.stderr)
        return False
    return True


def _set_views(client: Any, experiment: str) -> None:
    """Write the views and the description of an experiment, where they have changed."""
    methods = client.search_runs([experiment], filter_string=f"tags.{KIND} = '{METHOD}'", max_results=1000)
    tags = views((name for run in methods for name in run.data.metrics), len(methods))
    tags["mlflow.note.content"] = note(experiment)
    known = client.get_experiment(experiment).tags
    for name, value in tags.items():
        if known.get(name) != value:
            client.set_experiment_tag(experiment, name, value)


def _register(client: Any, experiment: str, log: RunLog) -> None:
    """Register the model of a training as a version of its study's model, unless it is one."""
    from mlflow.exceptions import MlflowException

    name = client.get_experiment(experiment).name
    try:
        client.create_registered_model(name, description="The grammars and networks of this study, a version each.")
    except MlflowException as error:
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise
    digest = log.tags["model"]
    if client.search_model_versions(f"name = '{name}' and tags.model = '{digest}'", max_results=1):
        return
    run = _find(client, experiment, log)
    assert run is not None, "logged just now"
    client.create_model_version(
        name,
        f"{run.info.artifact_uri}/model",
        run.info.run_id,
        tags={"model": digest, "data": log.tags["data"], "seed": str(log.params["seed"])},
        description=f"{log.name}; grammar.png and grammar.txt of its run show its productions",
    )


def _find(client: Any, experiment: str, log: RunLog) -> Any | None:
    """The run with this identity."""
    runs = client.search_runs([experiment], filter_string=f"tags.`{KEY}` = '{log.key}'", max_results=1)
    return runs[0] if runs else None


def _log_run(client: Any, experiment: str, log: RunLog, parent: str | None) -> None:
    """Create or update the run with this identity, and its children."""
    run = _find(client, experiment, log)
    if run is None:
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
    for name, samples in log.history.items():
        if name not in run.data.metrics:
            metrics += [Metric(name, value, moment, step) for step, (moment, value) in enumerate(samples)]
    params = [
        Param(name, str(value)[:MAX_PARAM_LENGTH]) for name, value in log.params.items() if name not in run.data.params
    ]
    named = dict(log.tags) | ({"mlflow.note.content": log.description} if log.description else {})
    tags = [RunTag(name, value) for name, value in named.items()]
    while metrics or params or tags:  # few requests, because each waits for the disk
        client.log_batch(run_id, metrics[: BATCH["metrics"]], params[: BATCH["params"]], tags)
        metrics, params, tags = metrics[BATCH["metrics"] :], params[BATCH["params"] :], []
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
    for name, text in (dict(log.texts) | dict(log.drawn() if log.drawn else {})).items():
        client.log_text(run_id, text, name)
    for file in log.files:
        client.log_artifact(run_id, str(file))
    if log.model is not None:
        client.log_artifacts(run_id, str(log.model), "model")


def store_folder(uri: str) -> Path:
    """Where the folder of artifacts of a store without a server is: that of its database."""
    path = database_file(uri)
    return Path.cwd() if path is None else path.resolve().parent
