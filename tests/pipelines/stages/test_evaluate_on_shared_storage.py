"""Evaluations whose data, models and recordings are in an object store."""

import shutil

import pytest

from cutgrammar.errors import InputError
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar_pipelines.config import EvaluateConfig, ViewConfig
from cutgrammar_pipelines.inspection.view import view
from cutgrammar_pipelines.stages.evaluate.run_trials import evaluate
from cutgrammar_workers.trial_worker import fetched
from object_store import names_at, object_store, upload


@pytest.fixture
def store(monkeypatch, tmp_path, data_folder, model_folder):
    monkeypatch.setenv("CUTGRAMMAR_CACHE", str(tmp_path / "cache"))
    with object_store(monkeypatch) as stop:
        upload(data_folder, "s3://lab/data")
        upload(model_folder, "s3://lab/model")
        yield stop


def run_quick(out, data="s3://lab/data", model="s3://lab/model", workers=0, **options):
    quick = {"setups": ["N1M1"], "trials": 2, "runs": 1, "world": "bench", "methods": ["halve"]}
    return evaluate(EvaluateConfig(data=data, model=model, out=out, workers=workers, **quick, **options))


def records_of(run):
    return {record.key.name: record for record in read_records(ledger_of(run))}


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_results_are_those_of_folders_and_recordings_are_in_the_store(
    workers, store, data_folder, model_folder, tmp_path, capsys
):
    run = tmp_path / "run"
    run_quick(run, record="all", artifacts="s3://lab/recordings", workers=workers)
    run_quick(tmp_path / "beside", data_folder, model_folder, workers=workers)  # as many threads
    records, same = records_of(run), records_of(tmp_path / "beside")
    assert {name: record.digest for name, record in records.items()} == {n: r.digest for n, r in same.items()}
    assert len(records) == 2
    (origin,) = {record.key.origin for record in records.values()}
    assert names_at("s3://lab/recordings") == sorted(f"{origin[:16]}/{name}.rrd" for name in records)
    assert not (run / "recordings").exists()
    facts = read_run(run)
    assert (facts.data, facts.models, facts.artifacts) == ("s3://lab/data", ("s3://lab/model",), "s3://lab/recordings")
    assert view(ViewConfig(run=run, trial=min(records), save=tmp_path / "saved.rrd")) == 0
    assert (tmp_path / "saved.rrd").read_bytes()[:3] == b"RRF"
    assert "carried out again" not in capsys.readouterr().err


def test_a_trial_without_recording_is_reproduced_from_the_store(store, tmp_path, capsys):
    run_quick(tmp_path / "run")
    shutil.rmtree(tmp_path / "cache")
    (name, *_) = records_of(tmp_path / "run")
    assert view(ViewConfig(run=tmp_path / "run", trial=name, save=tmp_path / "saved.rrd")) == 0
    assert "is carried out again" in (said := capsys.readouterr()).err
    assert "differs" not in said.err


def test_another_place_for_recordings_is_refused_in_an_existing_run(store, tmp_path):
    run, place = tmp_path / "run", f"file://{tmp_path}/recordings"
    run_quick(run, record="all", artifacts=place)
    assert len(list((tmp_path / "recordings").rglob("*.rrd"))) == 2
    with pytest.raises(InputError, match=f"was started with --artifacts {place}; give the same"):
        run_quick(run, record="all", artifacts="s3://lab/recordings")
    with pytest.raises(InputError, match="was started with --artifacts"):
        run_quick(run)
    with pytest.raises(ValueError, match="--artifacts is where recordings go; give --record"):
        run_quick(run, artifacts="s3://lab/recordings")


@pytest.mark.slow
def test_a_store_that_dies_costs_recordings_and_no_trial(store, data_folder, model_folder, tmp_path, capsys):
    store()
    run_quick(tmp_path / "run", data_folder, model_folder, record="all", artifacts="s3://lab/recordings")
    assert capsys.readouterr().err.count("has no recording: OSError") == 2
    assert len(records_of(tmp_path / "run")) == 2


def test_data_that_changes_while_a_node_fetches_it_is_refused(store, tmp_path):
    with pytest.raises(InputError, match="has changed since the evaluation began"):
        fetched("s3://lab/data", "0" * 64)


def test_data_that_is_not_in_the_store_gives_one_line(store, tmp_path):
    with pytest.raises(InputError, match="^s3://lab/nothing holds no files; see whether it exists"):
        run_quick(tmp_path / "run", data="s3://lab/nothing")
    assert not (tmp_path / "run").exists()
