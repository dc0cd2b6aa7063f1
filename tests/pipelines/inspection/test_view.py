"""Trials are listed, found, saved and carried out again."""

import os
import sys
from dataclasses import replace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, recording_of
from cutgrammar_dashboards.recording.recorder import Recorder
from cutgrammar_pipelines.config import ViewConfig
from cutgrammar_pipelines.inspection import view as viewing
from cutgrammar_pipelines.inspection.view import view
from cutgrammar_workers.trial_worker import Outcome


@pytest.fixture
def run(made, tmp_path):
    """A run of which the first trial is recorded."""
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1"], runs=1)
    folder = made.write_run(tmp_path / "run", facts, records, records)
    recorder = Recorder(str(recording_of(folder, records[0].key.name)), records[0].key.name, (), ())
    recorder.close()
    return folder


@pytest.fixture
def again(monkeypatch, tmp_path):
    """What is carried out again, by name; the outcome repeats the ledger's unless it is changed here."""
    asked, changes = [], {}

    def reproduce_trial(folder, key):
        asked.append(key.name)
        (record,) = [r for r in read_records(ledger_of(folder)) if r.key == key]
        path = tmp_path / "again.rrd"
        Recorder(str(path), key.name, (), ()).close()
        return Outcome(replace(record, **changes), path.read_bytes())

    monkeypatch.setattr(viewing, "reproduce_trial", reproduce_trial)
    return asked, changes


def test_without_a_trial_the_worst_are_listed(run, capsys):
    assert view(ViewConfig(run, worst=3)) == 0
    lines = capsys.readouterr().out.splitlines()
    names = [line[2:].split()[0] for line in lines[1:-1]]
    worst = sorted(read_records(ledger_of(run)), key=lambda r: r.iou_strict)
    assert names == [record.key.name for record in worst[:3]]
    assert lines[-1] == f"to see the first: cutgrammar view {run} {names[0]}"
    assert "stuck: the planner saw <b>no</b> cut & stopped" in "\n".join(lines)


def test_the_list_marks_recorded_trials(run, capsys):
    view(ViewConfig(run, worst=100))
    starred = [line for line in capsys.readouterr().out.splitlines()[1:-1] if line.startswith("*")]
    assert [line.split()[1] for line in starred] == ["N1M1-0-in-place-grammar-0-bench-truth"]


def test_the_recording_of_a_recorded_trial_is_copied(run, tmp_path, again):
    name = "N1M1-0-in-place-grammar-0-bench-truth"
    assert view(ViewConfig(run, name, save=tmp_path / "deep" / "one.rrd")) == 0
    assert (tmp_path / "deep" / "one.rrd").read_bytes() == recording_of(run, name).read_bytes()
    assert again[0] == []


def test_an_unrecorded_trial_is_carried_out_again_once_and_its_recording_is_kept(run, tmp_path, again, capsys):
    for _ in range(2):
        view(ViewConfig(run, "N1M1-1-in-place-random", save=tmp_path / "one.rrd"))
    assert again[0] == ["N1M1-1-in-place-random-0-bench-truth"]
    assert recording_of(run, again[0][0]).exists()
    assert "NOTE" not in capsys.readouterr().err


def test_a_note_says_that_a_trial_came_out_differently(run, tmp_path, again, capsys):
    again[1]["scores"] = {"iou_strict": 0.123}
    view(ViewConfig(run, "N1M1-1-in-place-random", save=tmp_path / "one.rrd"))
    assert "NOTE the result differs: strict IoU 0.123000" in capsys.readouterr().err


def test_the_worst_are_merged_into_one_file(run, tmp_path, again):
    from rerun.chunk import RrdReader

    assert view(ViewConfig(run, worst=3, save=tmp_path / "worst.rrd")) == 0
    assert len(RrdReader(str(tmp_path / "worst.rrd")).recordings()) == 3


def columns_of(recording):
    from rerun.chunk import RrdReader

    paths = {chunk.entity_path for chunk in RrdReader(str(recording)).stream()}
    return {path.split("/")[1] for path in paths if not path.startswith("/__")}


def test_two_methods_are_compared_on_the_trial_in_which_the_second_loses_most(run, tmp_path, again):
    assert view(ViewConfig(run, compare=("grammar", "random"), save=tmp_path / "both.rrd")) == 0
    score = {record.key.name: record.iou_strict for record in read_records(ledger_of(run))}
    pairs = [(name, name.replace("grammar", "random")) for name in score if "grammar" in name]
    grammar, random = min(pairs, key=lambda pair: score[pair[1]] - score[pair[0]])
    names = {f"grammar_strict_IoU_{score[grammar]:.3f}", f"random_strict_IoU_{score[random]:.3f}"}
    assert columns_of(tmp_path / "both.rrd") == {name.replace(".", "_") for name in names}


def test_the_trial_of_a_comparison_is_named_by_a_trial_of_either_method(run, tmp_path, again):
    for trial in ("N1M1-1-in-place-random-0-bench-truth", "N1M1-1-in-place-grammar", "N1M1-1"):
        view(ViewConfig(run, trial, compare=("random", "grammar"), save=tmp_path / "both.rrd"))
    assert set(again[0]) == {f"N1M1-1-in-place-{method}-0-bench-truth" for method in ("random", "grammar")}
    assert len(again[0]) == 2, "each is carried out again once, and its recording is kept"


@pytest.mark.parametrize(
    ("methods", "trial", "message"),
    [
        (("grammar", "grammar"), None, "two different methods, not grammar twice"),
        (("grammar", "bc"), None, "no trial of both grammar and bc"),
        (("grammar", "random"), "N9", "no trial called 'N9' in common; one that they have is N1M1-"),
    ],
)
def test_comparisons_that_cannot_be_made_are_refused(run, methods, trial, message):
    with pytest.raises(InputError, match=message):
        view(ViewConfig(run, trial, compare=methods))


def test_without_a_screen_the_commands_to_open_the_recording_are_printed(run, monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert view(ViewConfig(run, "N1M1-0-in-place-grammar")) == 0
    out = capsys.readouterr().out
    assert "There is no screen here" in out
    assert str(recording_of(run, "N1M1-0-in-place-grammar-0-bench-truth")) in out


def test_with_a_screen_the_viewer_is_opened_on_this_machine_only(run, monkeypatch):
    from cutgrammar_dashboards.recording import viewer

    calls = []
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(viewer.subprocess, "run", lambda command, **more: calls.append((command, more)) or Done())
    assert view(ViewConfig(run, "N1M1-0-in-place-grammar")) == 0
    ((command, more),) = calls
    assert command[1:3] == ["--bind", "127.0.0.1"]
    assert more["env"] == {**os.environ, "CI": "true"}


class Done:
    returncode = 0


def test_unknown_trials_are_refused_with_the_closest_name(run):
    with pytest.raises(InputError, match="the closest name is N1M1-0-in-place-grammar-0-bench-truth"):
        view(ViewConfig(run, "N1M1-0-in-place-grammer-0-bench-truth"))
    with pytest.raises(InputError, match="'N1M1' is a prefix of 8 names, such as"):
        view(ViewConfig(run, "N1M1"))


def test_runs_without_trials_and_folders_that_are_not_runs_are_refused(made, tmp_path):
    with pytest.raises(InputError, match="is not a run"):
        view(ViewConfig(tmp_path))
    facts = made.facts_of()
    empty = made.write_run(tmp_path / "empty", facts, made.records_of(facts)[:1], [])
    with pytest.raises(InputError, match="holds no trial yet"):
        view(ViewConfig(empty))
