import shutil
import sqlite3
from dataclasses import replace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.plugins import METHODS, reference_of
from cutgrammar.storage.ledger import read_attempts, read_records
from cutgrammar.storage.run_folder import ledger_of, recording_of
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.evaluate import provenance, run_trials
from cutgrammar_pipelines.stages.evaluate.reproduce import reproduce_trial
from quick_runs import run_quick

MOODY = """
from cutgrammar import Method, Stuck


class Moody:
    def next_cut(self, now, goal, refused, rng):
        {act}


MOODY = Method("moody", lambda _: Moody())
"""
BAD, GOOD = MOODY.format(act='raise ArithmeticError("cannot count")'), MOODY.format(act='return Stuck("tired")')


def reinstall(install, tmp_path, source):
    shutil.rmtree(tmp_path / "site-moody", ignore_errors=True)
    install("moody", source, methods={"moody": "MOODY"})


def test_a_trial_that_is_retried_has_its_new_record_and_keeps_the_earlier_attempt(given, tmp_path, install, capsys):
    run = tmp_path / "run"
    reinstall(install, tmp_path, BAD)
    assert run_quick(given, run, methods=["random", "moody"], record="failed").crashed == 1
    crashed = next(record for record in read_records(ledger_of(run)) if record.status == "crashed")
    assert recording_of(run, crashed.key.name).exists()
    reinstall(install, tmp_path, GOOD)
    capsys.readouterr()
    assert run_quick(given, run, methods=["random", "moody"], retry=["timeout"]).new == 0
    told = capsys.readouterr().err
    assert f"NOTE 1 records of {run} were made with code of method moody" in told
    assert told.count("NOTE") == 1  # random, and all that both have, is as it was
    summary = run_quick(given, run, methods=["random", "moody"], retry=["crashed"])
    assert (summary.new, summary.crashed, summary.stuck) == (1, 0, 1)
    rows = {record.key.method: record for record in read_records(ledger_of(run))}
    assert (rows["moody"].status, rows["moody"].reason) == ("stuck", "tired")
    text = as_text(build_report([run]))
    assert "crashed, and carried out again" in text
    assert "Versions that differ" not in text  # all records that count were made with the same
    assert not recording_of(run, crashed.key.name).exists()  # it showed the crash
    assert read_attempts(ledger_of(run)).superseded == {"crashed": 1}
    with sqlite3.connect(ledger_of(run)) as connection:
        kept = connection.execute("SELECT attempt, status, pid > 0, ended >= started, record IS NULL FROM attempts")
        assert sorted(kept.fetchall()) == [
            (1, "crashed", 1, 1, 0),
            (1, rows["random"].status, 1, 1, 1),
            (2, "stuck", 1, 1, 1),
        ]


def test_a_report_tells_which_records_were_made_with_which_code(given, tmp_path, install):
    run = tmp_path / "run"
    for source, trials in ((BAD, 1), (GOOD, 2)):
        reinstall(install, tmp_path, source)
        run_quick(given, run, methods=["random", "moody"], setups=["N1M2"], trials=trials)
    text = as_text(build_report([run]))
    table = text[text.index("Versions that differ") :]
    lines = [line.split() for line in table.splitlines() if line.startswith("code of method moody")]
    assert [line[-1] for line in lines] == ["1", "1"]
    assert "numpy" not in table


def test_every_record_has_the_versions_of_code_libraries_and_its_own_plugin(given, tmp_path, install):
    reinstall(install, tmp_path, GOOD)
    run_quick(given, tmp_path / "run", methods=["random", "moody"])
    sets = sorted((versions for versions, _ in read_attempts(ledger_of(tmp_path / "run")).versions), key=len)
    assert {"cutgrammar", "code", "commit", "numpy", "numba", "torch", "manifold3d", "sapien"} <= sets[0].keys()
    assert sets[1].keys() - sets[0].keys() == {"method moody", "code of method moody"}
    assert sets[1]["method moody"] == "moody 1.0"


def test_a_run_from_before_a_setting_was_added_is_resumed_and_reproduced(given, tmp_path, monkeypatch):
    run = tmp_path / "run"
    of_now = provenance.facts_of

    def of_before(*arguments):
        facts = of_now(*arguments)
        settings = {**facts.settings, "trial": {"max_refusals": facts.settings["trial"]["max_refusals"]}}
        return replace(facts, settings=settings)

    with monkeypatch.context() as before:
        before.setattr(run_trials, "facts_of", of_before)
        run_quick(given, run, methods=["random"])
    assert "max_seconds" not in (run / "run.json").read_text()
    summary = run_quick(given, run, methods=["random", "largest"])
    assert (summary.planned, summary.new, summary.complete) == (2, 1, True)
    for record in read_records(ledger_of(run)):
        assert reproduce_trial(run, record.key).record.digest == record.digest


def test_a_name_that_two_packages_register_is_refused_with_both(install):
    install("moody", GOOD, methods={"moody": "MOODY"})
    install("other", GOOD, methods={"moody": "MOODY"})
    words = r"method 'moody' is registered by moody 1\.0 \(moody:MOODY\) and other 1\.0 \(other:MOODY\); uninstall one"
    with pytest.raises(InputError, match=words):
        reference_of(METHODS, "moody")
