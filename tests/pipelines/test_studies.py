"""The scripts in studies/, loaded as modules."""

import importlib.util
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar_pipelines.reports.build import build_report

STUDIES = Path(__file__).parents[2] / "studies"


def script(name):
    spec = importlib.util.spec_from_file_location(name, STUDIES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_report_of_a_packed_ledger_is_the_report_of_the_run(scored_run, tmp_path):
    export = script("export_ledger")
    export.pack(scored_run, tmp_path / "ledger.parquet")
    assert export.report_of(tmp_path / "ledger.parquet").to_json() == build_report([scored_run]).to_json()
    assert (tmp_path / "ledger.parquet").stat().st_size < 40_000
    assert b"somewhere" not in (tmp_path / "ledger.parquet").read_bytes()


def test_an_incomplete_run_is_not_packed(made, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts)
    run = made.write_run(tmp_path / "run", facts, records, records[1:])
    with pytest.raises(InputError, match="run is incomplete: 1 trials are missing; resume it first"):
        script("export_ledger").pack(run, tmp_path / "ledger.parquet")
