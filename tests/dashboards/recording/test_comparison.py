"""Recordings of several trials become columns of one."""

import pytest
from rerun.chunk import RrdReader

import recordings
from cutgrammar.errors import InputError
from cutgrammar.untrusted.parser_processes import Answer
from cutgrammar_dashboards.recording import comparison
from cutgrammar_dashboards.recording.comparison import write_side_by_side


def contents(path, below=""):
    """{entity below `below`: number of its rows}."""
    counts = {}
    for chunk in RrdReader(str(path)).stream():
        path = chunk.entity_path
        if f"{path}/".startswith(f"{below}/") and not path.startswith("/__"):
            entity = path.removeprefix(below) or "/"
            counts[entity] = counts.get(entity, 0) + chunk.num_rows
    return counts


@pytest.mark.parametrize("kind", ["story", "arm_story"])
def test_every_column_has_all_that_its_recording_has(kind, request, tmp_path):
    whole = recordings.record(tmp_path / "whole.rrd", *request.getfixturevalue(kind))
    start, goal, events = request.getfixturevalue("story")
    short = recordings.record(tmp_path / "short.rrd", start, goal, events[:3])
    out = tmp_path / "deep" / "both.rrd"
    write_side_by_side({"guided, .9": whole, "halve, .5": short}, "a trial", out)
    assert contents(out, "/guided_9") == contents(whole)
    assert contents(out, "/halve_5") == contents(short)
    assert [file.name for file in out.parent.iterdir()] == ["both.rrd"]


def test_a_recording_that_kills_rerun_is_refused(story, tmp_path, monkeypatch):
    whole = recordings.record(tmp_path / "whole.rrd", *story)
    monkeypatch.setattr(comparison, "run_parser", lambda *_: Answer(-6, b"", ""))
    with pytest.raises(InputError, match=r"whole.rrd cannot be read \(it ends the process that reads it"):
        write_side_by_side({"a": whole}, "a trial", tmp_path / "both.rrd")
    assert [file.name for file in tmp_path.iterdir()] == ["whole.rrd"]


def test_what_is_no_recording_and_names_that_fall_together_are_refused(story, tmp_path):
    whole = recordings.record(tmp_path / "whole.rrd", *story)
    (tmp_path / "torn.rrd").write_bytes(whole.read_bytes()[:100])
    with pytest.raises(InputError, match="torn.rrd is no recording that can be read"):
        write_side_by_side({"a": whole, "b": tmp_path / "torn.rrd"}, "a trial", tmp_path / "both.rrd")
    with pytest.raises(InputError, match="cannot be told apart"):
        write_side_by_side({"a b": whole, "a-b": whole}, "a trial", tmp_path / "both.rrd")
    assert not (tmp_path / "both.rrd").exists()
