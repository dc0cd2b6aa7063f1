import dataclasses
import shutil
import sqlite3
from pathlib import Path

import pytest

from cutgrammar.storage.attempts import Attempt, AttemptSummary, differing_versions
from cutgrammar.storage.ledger import (
    Ledger,
    read_attempts,
    read_known_configurations,
    read_planned,
    read_records,
)
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.built_in_scores import COMPUTED
from cutgrammar.trials.record import TrialKey, record_of_death

KEY, OTHER = (TrialKey("N1M1", trial, "in-place", "random", 0, "bench", "truth", "0") for trial in (3, 20))
SAMPLES = Path(__file__).parents[1] / "data"
OLD, NEW = {"numpy": "1.0", "code": "a", "commit": "c"}, {"numpy": "2.0", "code": "a", "commit": "d"}


def a_record(key, reason="gone"):
    return record_of_death(key, 4, package="0.1.0", reason=reason, traceback="", scores=COMPUTED)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run" / "ledger.sqlite"


def rows(path, columns):
    with sqlite3.connect(path) as connection:
        return connection.execute(f"SELECT {columns} FROM attempts ORDER BY key, attempt").fetchall()


def test_who_made_a_record_when_and_with_which_versions_is_kept_and_versions_once(path):
    with Ledger(path) as ledger:
        for key in (KEY, OTHER):
            ledger.add(a_record(key), None, Attempt("here", 7, 10.0, 12.5, OLD))
    assert (
        rows(path, "attempt, status, reason, host, pid, started, ended, versions, record")
        == [(1, "crashed", "gone", "here", 7, 10.0, 12.5, 1, None)] * 2
    )
    assert read_attempts(path).versions == ((OLD, 2),)


def test_a_record_that_is_replaced_is_kept_with_its_attempt_and_counts_no_more(path):
    with Ledger(path) as ledger:
        ledger.add(a_record(KEY), None, Attempt(versions=OLD))
        ledger.add_fault(KEY, "the disk was full", Attempt(versions=NEW))
        assert ledger.add(a_record(KEY, "again"), None, Attempt(versions=NEW), replaces=True)
        assert ledger.keys(["crashed"]) == {KEY.digest}
        assert ledger.keys(["timeout", "failed"]) == set()
    assert [record.reason for record in read_records(path)] == ["again"]
    assert [row[:3] for row in rows(path, "attempt, status, reason, record")] == [
        (1, "crashed", "gone"),
        (2, "infrastructure", "the disk was full"),
        (3, "crashed", "again"),
    ]
    kept = [record for (record,) in rows(path, "record")]
    assert '"reason": "gone"' in kept[0]
    assert kept[1:] == [None, None]
    assert read_attempts(path).versions == ((NEW, 1),)
    assert read_attempts(path).superseded == {"crashed": 1, "infrastructure": 1}


def test_versions_differ_where_one_name_has_two_and_commits_only_with_the_code():
    plugin = {**OLD, "code of method mine": "1"}
    assert differing_versions([(OLD, 3), (plugin, 2), (NEW, 1)]) == {"numpy": {"1.0": 5, "2.0": 1}}
    assert differing_versions([(OLD, 3), (OLD | {"code": "b", "commit": "d"}, 1)]) == {
        "code": {"a": 3, "b": 1},
        "commit": {"c": 3, "d": 1},
    }


@pytest.mark.parametrize(("schema", "n"), [(1, 12), (2, 4)])
def test_a_ledger_of_every_release_is_read(schema, n, tmp_path):
    path = ledger_of(shutil.copytree(SAMPLES / f"schema_{schema}_run", tmp_path / "run"))
    assert len(read_records(path)) == len(read_planned(path)) == n
    assert read_attempts(path) == AttemptSummary((), {})


def test_a_ledger_of_schema_2_becomes_one_of_schema_3_when_it_is_written_and_keeps_all_that_it_had(tmp_path):
    path = ledger_of(shutil.copytree(SAMPLES / "schema_2_run", tmp_path / "run"))
    records, planned = read_records(path), read_planned(path)
    shapes = read_known_configurations(path, planned)
    assert len(shapes) == 4
    with Ledger(path) as ledger:
        assert not ledger.add(records[0])
        new = dataclasses.replace(records[0], key=dataclasses.replace(records[0].key, run=7))
        assert ledger.add(new, None, Attempt(versions=NEW))
    assert read_planned(path) == planned
    assert read_records(path) == sorted([*records, new], key=lambda record: record.key)
    assert read_known_configurations(path, planned).keys() == shapes.keys()
    assert read_attempts(path).versions == (({}, 4), (NEW, 1))
    Ledger(path).close()
    assert len(rows(path, "key")) == 5
