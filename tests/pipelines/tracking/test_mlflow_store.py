"""Against a real store; importing mlflow alone takes seconds."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from browser import browser
from cutgrammar.errors import InputError
from cutgrammar.settings import from_tables
from cutgrammar_pipelines.config import CollectConfig, MlflowConfig, SplitConfig, TrainConfig
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import train
from cutgrammar_pipelines.tracking import mlflow_store as tracking
from cutgrammar_pipelines.tracking import serving
from cutgrammar_pipelines.tracking.chart_page import link
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from cutgrammar_pipelines.tracking.mlflow_store import (
    log_evaluation,
    log_training,
    open_store,
    store_name,
)
from cutgrammar_pipelines.tracking.new_database import one_at_a_time
from cutgrammar_pipelines.tracking.run_log import RunLog, Study
from cutgrammar_pipelines.tracking.serving import serve

pytestmark = pytest.mark.slow

PATIENCE = 300_000
"""Longest time that a page may take on a busy machine [ms]."""


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory):
    """Made once: MLflow takes seconds for it."""
    folder = tmp_path_factory.mktemp("mlflow")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder / 'mlflow.db'}")
        open_store()
    return folder / "mlflow.db"


@pytest.fixture
def store(tmp_path, monkeypatch, empty_database):
    """The default store of an empty folder; afterwards, all its runs of an experiment."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.chdir(tmp_path)
    shutil.copy(empty_database, tmp_path / "mlflow.db")

    def runs(name):
        client = open_store().client
        found = client.get_experiment_by_name(name)
        return client, client.search_runs([found.experiment_id], order_by=["attributes.start_time ASC"])

    return runs


def top_level(runs):
    return [run for run in runs if run.data.tags["kind"] == "method"]


def test_an_evaluation_is_logged_once_however_often_it_is_sent(store, scored_run):
    report = build_report([scored_run])
    assert log_evaluation(scored_run, report)
    client, first = store(scored_run.parent.name)
    assert len(first) == sum(1 + len(log.children) for log in evaluation_logs(scored_run, report))
    top = top_level(first)
    assert len(top) == 4
    assert {r.info.status for r in first} == {"FINISHED"}
    rows = {(row["method"], row["setup"]): row for row in report.numbers["rows"]}
    for one in top:
        method = one.data.params["method"]
        assert one.data.metrics["iou_strict/N1M1"] == pytest.approx(rows[method, "N1M1"]["iou_strict_mean"])
        assert one.data.params["search.max_rounds"] == "50"
        assert one.inputs.dataset_inputs[0].dataset.digest == "d" * 36
        assert {f.path for f in client.list_artifacts(one.info.run_id)} == {"trials.csv"}
        children = [r for r in first if r.data.tags.get("mlflow.parentRunId") == one.info.run_id]
        assert len(children) == len(first) // 4 - 1
    (of_report,) = (run for run in first if run.data.tags["kind"] == "report")
    assert {f.path for f in client.list_artifacts(of_report.info.run_id)} == {"figures", "report.json"}
    assert log_evaluation(scored_run, report)
    _, again = store(scored_run.parent.name)
    assert [r.to_dictionary() for r in again] == [r.to_dictionary() for r in first]
    assert Path("mlartifacts").is_dir(), "beside the database"


def test_rows_that_come_later_update_the_runs_that_are_there(store, scored_run, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(scored_run, folder)
    assert log_evaluation(folder, build_report([folder]))
    client, first = store(tmp_path.name)
    report = build_report([folder])
    for row in report.numbers["rows"]:
        row["iou_strict_mean"] -= 0.1  # down: the later value counts, not the larger
    assert log_evaluation(folder, report)
    _, again = store(tmp_path.name)
    assert [r.info.run_id for r in again] == [r.info.run_id for r in first]
    for old, new in zip(top_level(first), top_level(again), strict=True):
        assert new.data.metrics["iou_strict/N1M1"] == pytest.approx(old.data.metrics["iou_strict/N1M1"] - 0.1)
        assert new.data.metrics["iou/N1M1"] == old.data.metrics["iou/N1M1"]
        assert len(client.get_metric_history(new.info.run_id, "iou/N1M1")) == 1


def test_an_interrupted_log_is_completed(store, scored_run, monkeypatch, capsys):
    log_content, calls = tracking._log_content, []

    def fail_at_sixth_call(client, run, log):
        calls.append(log)
        log_content(client, run, log)
        if len(calls) == 6:
            raise ConnectionError("gone")

    monkeypatch.setattr(tracking, "_log_content", fail_at_sixth_call)
    report = build_report([scored_run])
    assert not log_evaluation(scored_run, report)
    assert "cannot be used (gone)" in capsys.readouterr().err
    monkeypatch.setattr(tracking, "_log_content", log_content)
    assert log_evaluation(scored_run, report)
    client, runs = store(scored_run.parent.name)
    assert len(runs) == sum(1 + len(log.children) for log in evaluation_logs(scored_run, report))
    assert {r.info.status for r in runs} == {"FINISHED"}
    for one in runs:
        for name in one.data.metrics:
            assert len(client.get_metric_history(one.info.run_id, name)) == 1
        assert len(one.inputs.dataset_inputs if one.inputs else ()) <= 1


def test_curves_keep_their_steps_and_long_ones_are_sent_in_batches(store):
    points = [(k, -100.0 / k) for k in range(1, 2501)]
    log = RunLog("x", {"x": 1}, params={f"p{i}": i for i in range(150)}, curves={"over_k/objective_mean": points})
    for _ in range(2):
        assert tracking.log_runs(Study("long", "d"), [log], "")
    client, runs = store("long")
    history = client.get_metric_history(runs[0].info.run_id, "over_k/objective_mean")
    assert sorted((point.step, point.value) for point in history) == points
    assert len(runs[0].data.params) == 150


@pytest.fixture
def report(scored_run):
    """Of the run; what making it says is not among what a test that lists it before `capsys` captures."""
    return build_report([scored_run])


def closed_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@pytest.mark.timeout(120)  # without our settings one call to a dead server hangs for four minutes
def test_a_dead_server_costs_one_line_and_no_long_wait(scored_run, report, monkeypatch, capsys):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://user:secret@127.0.0.1:{closed_port()}")
    open_store()  # imports
    assert not log_evaluation(scored_run, report)
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "warning: MLflow at http://...@127.0.0.1" in told
    assert f"cutgrammar sync {scored_run} logs it later" in told
    assert "secret" not in told.split("cannot be used")[0]


@pytest.mark.timeout(120)
def test_a_hung_server_costs_no_long_wait_either(scored_run, monkeypatch, capsys):
    with socket.socket() as hung:
        hung.bind(("127.0.0.1", 0))
        hung.listen(16)
        monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{hung.getsockname()[1]}")
        report = build_report([scored_run])
        assert not log_evaluation(scored_run, report)
    assert "cannot be used" in capsys.readouterr().err


@pytest.mark.parametrize("uri", ["sqlite:////proc/none/mlflow.db", "gopher://x", "postgresql://127.0.0.1:9/x"])
def test_a_store_that_cannot_be_is_one_line(scored_run, report, monkeypatch, capsys, uri):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    assert not log_evaluation(scored_run, report)
    assert capsys.readouterr().err.count("\n") == 1


def test_a_torn_database_is_one_line(scored_run, report, monkeypatch, capsys, tmp_path):
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mlflow.db").write_bytes(b"not a database" * 100)
    assert not log_evaluation(scored_run, report)
    assert capsys.readouterr().err.count("\n") == 1


def test_the_page_needs_a_store_and_shows_what_was_told(store, scored_run, monkeypatch, tmp_path):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'none.db'}")
    with pytest.raises(InputError, match="there is no store"):
        serve(MlflowConfig())
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    assert log_evaluation(scored_run, build_report([scored_run]))
    _, runs = store(scored_run.parent.name)
    with server() as address:
        text = patiently(f"{address}/get-artifact?path=trials.csv&run_uuid={top_level(runs)[0].info.run_id}")
    assert text.startswith("setup,trial,goals,run,status")


def test_the_chart_page_opens_on_the_score_that_decides_best_method_first_and_without_assistant(store, scored_run):
    assert log_evaluation(scored_run, build_report([scored_run]))
    client, _ = store(scored_run.parent.name)
    experiment = client.get_experiment_by_name(scored_run.parent.name).experiment_id
    with server() as address, browser() as chromium:
        page = chromium.new_page(viewport={"width": 1500, "height": 1000})
        asked = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(f"{address}{link(experiment)}", timeout=PATIENCE)
        page.locator(".barlayer .point").first.wait_for(timeout=PATIENCE)
        page.get_by_text("iou_strict/N2M1").first.wait_for(timeout=PATIENCE)
        text = page.locator("body").inner_text()
        assert page.locator("[data-assistant-ui]:visible").count() == 0
    charts = text[text.index("Add chart") :]
    places = [charts.index(name) for name in ("iou_strict/mean", "iou_strict/N1M1", "iou_strict/N2M1")]
    assert places == sorted(places), "Table I, the mean first"
    assert not re.search("^iou/|^failures", charts[: places[-1]], re.MULTILINE), "which come before it by the alphabet"
    names = [line for line in text.splitlines() if line in ("grammar", "largest", "random", "replay")]
    assert names[:4] == ["replay", "grammar", "largest", "random"]
    assert "run 0" not in text, "seeds are within their methods"
    assert {urlsplit(url).hostname for url in asked if url.startswith("http")} == {"127.0.0.1"}


@contextmanager
def server():
    """The page that `cutgrammar mlflow` starts; yields its address."""
    port = closed_port()
    command = [sys.executable, "-m", "cutgrammar_pipelines", "mlflow", "--port", str(port), "--no-browser"]
    process = subprocess.Popen(command, start_new_session=True)
    try:
        patiently(f"http://127.0.0.1:{port}/health")
        yield f"http://127.0.0.1:{port}"
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(300)


def patiently(address):
    for _ in range(600):
        try:
            with urllib.request.urlopen(address, timeout=30) as answer:
                return answer.read().decode()
        except OSError:
            time.sleep(0.5)
    raise TimeoutError(address)


def test_the_latest_study_is_opened_or_the_one_that_is_named(store):
    for name in ("old", "new"):
        assert tracking.log_runs(Study(name, "d"), [RunLog(name, {"x": name}, tags={"kind": "method"})], "")
        time.sleep(0.01)
    ids = {one.name: one.experiment_id for one in open_store().client.search_experiments()}
    assert serving._pages(None) == link(ids["new"])
    assert serving._pages("old") == link(ids["old"])
    with pytest.raises(InputError, match="has no study 'none'; those that it has: new, old"):
        serving._pages("none")


def test_a_port_that_is_taken_is_refused_with_another_one(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    (tmp_path / "mlflow.db").touch()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"port {port} cannot be used on this machine; try --port \d+$"):
            serve(MlflowConfig(port=port))


@pytest.mark.parametrize(
    ("uri", "shown"),
    [
        ("postgresql://me:secret@db/x", "postgresql://...@db/x"),
        ("http://me:secret@[::1", "http://...@[::1"),
        ("http://me:secret@host:port", "http://...@host:port"),
        ("postgresql://db/x?user=me&password=secret", "postgresql://db/x?user=me&password=..."),
    ],
)
def test_the_name_shown_has_no_password(uri, shown, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    assert store_name() == shown


@pytest.mark.parametrize("password", ["se/cret", "se@cret", "se%2Fcret", "se:cret"])
def test_an_odd_password_is_not_shown_either(password, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://me:{password}@host/x")
    assert "cret" not in store_name()
    assert "cret" not in tracking.without_password(f"cannot reach http://me:{password}@host/x/api as {password}")


def test_the_default_store_is_a_file_of_the_folder(monkeypatch):
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert store_name() == f"sqlite:///{Path('mlflow.db').resolve()}"


def test_a_store_that_another_process_keeps_locked_is_used_after_a_while(tmp_path):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    (tmp_path / "mlflow.db").touch()
    entered = []
    with one_at_a_time(uri, 60.0), one_at_a_time(uri, 0.3):
        entered.append(True)
    assert entered


def test_a_training_is_one_run_with_its_curves_and_registers_its_model(store, tmp_path):
    tables = {"features": {"epochs": 3}, "induction": {"max_k": 6, "n_starts": 1}, "classifier": {"epochs": 4}}
    tables |= {"planes": {"epochs": 4}, "baselines": {"epochs": 4, "plane_epochs": 4}}
    data, model = tmp_path / "data", tmp_path / "model"
    collect(CollectConfig(out=data, trials=12, setups=["N1M1"], workers=0))
    split(SplitConfig([data], out=data))
    config = TrainConfig(data=data, out=model, settings=from_tables(tables, __file__))
    trained = train(config)
    assert log_training(trained, data, history={"system/cpu_utilization_percentage": [(1000, 50.0), (11000, 60.0)]})
    client, (run,) = store(tmp_path.name)
    assert (run.info.run_name, run.data.tags["kind"], run.data.tags["model"]) == (
        "model",
        "training",
        trained.model.digest,
    )
    history = {
        name: client.get_metric_history(run.info.run_id, name)
        for name in ("over_k/objective_mean", "loss/encoder", "system/cpu_utilization_percentage")
    }
    for name in ("classifier", "planes", "bc", "qnet", "goal_planes"):
        assert len(client.get_metric_history(run.info.run_id, f"held_out_loss/{name}")) == 4
    assert [point.step for point in history["over_k/objective_mean"]] == [1, 2, 3, 4, 5, 6]
    assert [point.value for point in history["loss/encoder"]] == list(trained.learned.encoder_losses)
    assert [point.timestamp for point in history["system/cpu_utilization_percentage"]] == [1000, 11000]
    assert run.data.params["features.epochs"] == "3"
    assert run.inputs.dataset_inputs[0].dataset.digest == trained.model.provenance.data[:36]
    found = {f.path for f in client.list_artifacts(run.info.run_id)}
    assert found == {"grammar.png", "grammar.txt", "gammas.json", "induction.svg", "losses.svg", "model"}
    (version,) = client.search_model_versions(f"name = '{tmp_path.name}'")
    assert (version.run_id, version.tags["model"]) == (run.info.run_id, trained.model.digest)
    assert log_training(train(config), data)
    _, (again,) = store(tmp_path.name)
    assert again.data.to_dictionary()["metrics"] == run.data.to_dictionary()["metrics"]
    assert len(client.search_model_versions(f"name = '{tmp_path.name}'")) == 1


def test_studies_of_one_name_and_other_data_have_experiments_of_their_own(store):
    for digest in ("a" * 64, "b" * 64, "a" * 64):
        assert tracking.log_runs(Study("out", digest), [RunLog(digest[:2], {"x": digest})], "")
    _, first = store("out")
    _, second = store("out (bbbbbbbb)")
    assert [run.info.run_name for run in first + second] == ["aa", "bb"]
