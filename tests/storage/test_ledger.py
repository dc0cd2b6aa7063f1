import dataclasses
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings
from cutgrammar.storage import attempts
from cutgrammar.storage.attempts import Attempt
from cutgrammar.storage.ledger import Entry, Ledger, read_planned, read_records
from cutgrammar.storage.run_folder import ADDED, RunFacts, read_run, resumed, settle_run
from cutgrammar.trials.built_in_scores import COMPUTED
from cutgrammar.trials.record import TrialKey, record_of_death

KEYS = [
    TrialKey("N1M1", trial, "in-place", "random", run, "bench", "truth", "0") for trial in (3, 20) for run in (0, 1)
]
FACTS = RunFacts(
    0, {"search": {"keys": 4}}, "d" * 64, (), "paper", "s" * 64, ("m" * 64,), "0.1.0", "/d", ("/m",), None, {}
)


def a_record(key):
    return record_of_death(key, 4, package="0.1.0", reason="gone", traceback="", scores=COMPUTED)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run" / "ledger.sqlite"


def test_records_come_back_as_they_were_written_in_the_order_of_their_keys(path):
    with Ledger(path) as ledger:
        for key in reversed(KEYS):
            assert ledger.add(a_record(key))
        assert ledger.keys() == {key.digest for key in KEYS}
    assert read_records(path) == [a_record(key) for key in KEYS]


def test_records_that_came_together_are_written_all_or_none(path, monkeypatch):
    entries = [Entry(a_record(key), None, Attempt()) for key in KEYS]
    with Ledger(path) as ledger:
        assert ledger.add_all(entries[:2]) == 2
        assert ledger.add_all(entries[1:3]) == 1
        monkeypatch.setattr(attempts, "add_attempt", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            ledger.add_all(entries)
    assert [record.key for record in read_records(path)] == KEYS[:3]


def test_records_can_be_read_without_what_happened_in_their_trials(path):
    eventful = dataclasses.replace(
        a_record(KEYS[0]), events=({"event": "GaveUp", "step": 0, "reason": "x"},), seconds=0.1
    )
    with Ledger(path) as ledger:
        ledger.add(eventful)
    assert read_records(path, events=False) == [dataclasses.replace(eventful, events=())]
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE records SET record = 'torn'")
    with pytest.raises(InputError, match="ledger"):
        read_records(path, events=False)


def test_a_second_record_of_one_key_changes_nothing(path):
    with Ledger(path) as ledger:
        assert ledger.add(a_record(KEYS[0]))
        assert not ledger.add(dataclasses.replace(a_record(KEYS[0]), reason="again"))
    assert [record.reason for record in read_records(path)] == ["gone"]


def test_what_was_planned_is_kept_and_grows(path):
    with Ledger(path) as ledger:
        ledger.plan(KEYS[:2])
        ledger.plan(KEYS[1:])
    assert read_planned(path) == KEYS


def test_a_ledger_is_read_while_it_is_written(path):
    with Ledger(path) as ledger:
        ledger.add(a_record(KEYS[0]))
        assert len(read_records(path)) == 1


def test_a_second_driver_is_refused_in_one_line_until_the_first_has_closed_the_ledger(path):
    with Ledger(path), pytest.raises(InputError, match="is being evaluated by another process") as caught:
        Ledger(path)
    assert "\n" not in str(caught.value)
    Ledger(path).close()


def test_columns_can_be_queried_without_this_package(path):
    with Ledger(path) as ledger:
        ledger.add(a_record(KEYS[0]))
    with sqlite3.connect(path) as connection:
        assert connection.execute("SELECT setup, trial, method, status FROM records").fetchall() == [
            ("N1M1", 3, "random", "crashed")
        ]
        scores = "SELECT trial, score, value FROM scores WHERE score IN ('iou', 'spectral') ORDER BY score"
        assert connection.execute(scores).fetchall() == [(3, "iou", None), (3, "spectral", 1.0)]


def foreign(path):
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE other (x)")


def garbage(path):
    path.write_bytes(b"this is not a database, though it is long enough to look at" * 40)


def torn(path):
    with Ledger(path) as ledger:
        for key in KEYS:
            ledger.add(dataclasses.replace(a_record(key), reason="long " * 500))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def older(path):
    Ledger(path).close()
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 99")


def no_text(path):
    """A table whose name is no UTF-8, which SQLite repeats in its message."""
    Ledger(path).close()
    content = path.read_bytes()
    assert b"CREATE TABLE contents" in content
    path.write_bytes(content.replace(b"CREATE TABLE contents", b"CREATE TABXX cont\xac\xffts"))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (foreign, "not a ledger"),
        (no_text, "torn or foreign"),
        (garbage, "torn or foreign"),
        (torn, "torn"),
        (older, "schema 99, not 3: it is of another version"),
    ],
)
def test_a_torn_or_foreign_ledger_is_refused_with_one_line(path, spoil, words):
    path.parent.mkdir()
    spoil(path)
    for use in (Ledger, read_records, read_planned):
        with pytest.raises(InputError, match=words) as caught:
            use(path)
        assert "\n" not in str(caught.value)


def test_reading_a_missing_ledger_names_it_and_does_not_create_it(path):
    with pytest.raises(InputError, match="there is no ledger"):
        read_records(path)
    assert not path.parent.exists()


def test_an_empty_file_from_a_driver_killed_at_the_very_start_becomes_a_ledger(path):
    path.parent.mkdir()
    path.touch()
    with Ledger(path) as ledger:
        assert ledger.keys() == set()


def test_every_record_reported_written_survives_sigkill_and_the_lock_is_free(path):
    program = textwrap.dedent(
        f"""
        import sys
        from pathlib import Path
        from cutgrammar.storage.ledger import Ledger
        from cutgrammar.trials.record import TrialKey, record_of_death
        ledger = Ledger(Path({str(path)!r}))
        for trial in range(10**6):
            key = TrialKey("N1M1", trial, "in-place", "random", 0, "bench", "truth", "0")
            ledger.add(record_of_death(key, 4, package="0.1.0", reason="gone", traceback="", scores=()))
            print(trial, flush=True)
        """
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as driver:
        for _ in range(20):
            driver.stdout.readline()
        os.kill(driver.pid, signal.SIGKILL)
        reported = 20 + len(driver.stdout.read().splitlines())
    trials = [record.key.trial for record in read_records(path)]
    assert trials == list(range(len(trials)))
    assert reported <= len(trials) <= reported + 1
    with Ledger(path) as ledger:
        assert len(ledger.keys()) == len(trials)


def test_a_run_is_not_created_in_a_folder_with_other_files(tmp_path):
    (tmp_path / "manifest.json").touch()
    with pytest.raises(InputError, match=r"is not a run: it holds manifest\.json; choose another --out"):
        settle_run(tmp_path, FACTS)
    with pytest.raises(InputError, match=r"cannot be created: .*; choose another place with --out"):
        settle_run(tmp_path / "manifest.json", FACTS)


def test_a_run_is_created_once_and_resumed_only_with_the_same_facts(tmp_path):
    run = tmp_path / "run"
    settle_run(run, FACTS)
    settle_run(run, dataclasses.replace(FACTS, data="/elsewhere", commit="abc", machine={"cpus": 64}))
    assert read_run(run) == FACTS
    for other, words in [
        ({"seed": 1}, "started with seed = 0, not 1"),
        ({"settings": {"search": {"keys": 8}}}, "started with settings.search.keys = 4, not 8"),
        ({"model_digests": ("x" * 64,)}, r"started with model_digests\.0 = m{12}\.\.\., not x{12}\.\.\."),
        ({"model_digests": ("m" * 64, "n" * 64)}, r"started with model_digests\.1 = None, not n{12}\.\.\."),
        ({"package": "9"}, "started with package = 0.1.0, not 9"),
    ]:
        with pytest.raises(InputError, match=words):
            settle_run(run, dataclasses.replace(FACTS, **other))


def test_a_run_from_before_a_setting_was_added_has_the_value_that_changed_nothing(tmp_path):
    run = tmp_path / "run"
    before = dataclasses.replace(FACTS, settings={"trial": {"max_refusals": 10}})
    settle_run(run, before)
    now = dataclasses.replace(FACTS, settings={"trial": {"max_refusals": 10, "max_seconds": 3600.0}})
    settle_run(run, now)
    assert resumed(run, now).origins == before.origins != now.origins
    other = dataclasses.replace(FACTS, settings={"trial": {"max_refusals": 10, "max_seconds": 5.0}})
    assert resumed(run, other) == other
    with pytest.raises(InputError, match=r"settings\.trial\.max_seconds = 3600\.0, not 5\.0"):
        settle_run(run, other)
    assert resumed(tmp_path / "none", now) == now


def test_every_setting_that_was_added_since_the_last_release_says_what_runs_without_it_had():
    """A setting that is not in the sample needs an entry in `ADDED`, or runs of the release cannot be resumed."""
    kept = read_run(Path(__file__).parents[1] / "data" / "schema_2_run").settings
    names = {table: {*values, *ADDED.get(table, {})} for table, values in kept.items()}
    assert names == {table: set(values) for table, values in dataclasses.asdict(Settings()).items()}


def test_the_error_for_a_damaged_or_missing_run_names_the_folder(tmp_path):
    with pytest.raises(InputError, match="is not a run: it has no run"):
        read_run(tmp_path)
    settle_run(tmp_path, FACTS)
    (tmp_path / "run.json").write_text('{"schema": 1, "seed"')
    with pytest.raises(InputError, match=r"run\.json is torn"):
        read_run(tmp_path)
    (tmp_path / "run.json").write_text('{"schema": 7}')
    with pytest.raises(InputError, match="has schema 7, not 2"):
        read_run(tmp_path)
    shutil.rmtree(tmp_path)
    Ledger(tmp_path / "ledger.sqlite").close()
    with pytest.raises(InputError, match=r"has a ledger but no run\.json"):
        settle_run(tmp_path, FACTS)
