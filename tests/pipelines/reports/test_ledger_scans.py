"""Commands read a ledger once, however many tables they make from it."""

import dataclasses
import sqlite3

import pytest

from cutgrammar.storage import ledger_file
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines.reports.reported import is_reported, note_reported


@pytest.fixture
def statements(monkeypatch):
    """What is asked of SQLite while the test runs, from a process that knows no file yet."""
    asked, connect = [], sqlite3.connect

    def traced(*arguments, **options):
        connection = connect(*arguments, **options)
        connection.set_trace_callback(asked.append)
        return connection

    monkeypatch.setattr(sqlite3, "connect", traced)
    monkeypatch.setattr(ledger_file, "_WHOLE", set())
    return asked


def scans(statements):
    """Statements that read the text of all records, and those that read every page of the file."""
    texts = [text for text in statements if "CAST(" in text and "FROM records" in text]
    assert sum("FROM planned WHERE key NOT IN" in text for text in statements) <= 1, "missing rows are counted again"
    return len(texts), sum("quick_check" in text for text in statements)


def test_a_report_and_its_log_scan_the_ledger_once(scored_run, statements):
    from cutgrammar_pipelines.reports.build import build_report, read_rows
    from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs

    read = read_rows([scored_run])
    report = build_report([scored_run], read=read)
    logs = evaluation_logs(scored_run, report, records=[row.record for row in read.rows])
    assert len(logs) > 1
    assert scans(statements) == (1, 1)


def test_a_printed_report_scans_the_ledger_once(scored_run, statements, tmp_path, capsys):
    from cutgrammar_pipelines.config import ReportConfig
    from cutgrammar_pipelines.reports.build import report

    report(ReportConfig(runs=(scored_run,), out=tmp_path / "page.html"))
    assert scans(statements) == (1, 1)


def test_a_condensed_record_has_the_digest_and_what_reports_show(scored_run):
    record = read_records(ledger_of(scored_run))[0]
    events = ({"event": "Planned", "step": 0}, {"event": "CutMade", "step": 0}, {"event": "Scored", "pairs": []})
    whole = dataclasses.replace(record, events=events)
    condensed = whole.condensed()
    assert condensed.digest == whole.digest != record.digest
    assert condensed.events == ({"event": "Scored", "pairs": []},)


def test_a_run_is_reported_until_its_ledger_or_store_changes(tmp_path):
    file = ledger_of(tmp_path)
    file.write_bytes(b"rows")
    assert not is_reported(tmp_path, "here")
    note_reported(tmp_path, "here")
    assert is_reported(tmp_path, "here")
    assert not is_reported(tmp_path, "elsewhere")
    file.write_bytes(b"more rows")
    assert not is_reported(tmp_path, "here")
