"""The motions of an arm in a trial are exported for a real arm, with a line for every limit that is exceeded."""

import dataclasses
import re

import numpy as np
import pytest
import yaml

from cutgrammar.errors import InputError
from cutgrammar.events import Scored
from cutgrammar.trials.trajectory import trajectory_from_json
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.config import ExportConfig
from cutgrammar_pipelines.inspection import trial_trace
from cutgrammar_pipelines.inspection.export import export

TRIAL = "N1M1-0-in-place-grammar-0-kinova-truth"


def test_a_folder_gets_both_files_named_by_the_trial(arm_run, arm_events, carried_out, tmp_path, capsys):
    carried_out(arm_events)
    assert export(ExportConfig(arm_run, "N1M1-0-in-place-grammar-0-kin", out=tmp_path / "deep" / "out")) == 0
    files = sorted((tmp_path / "deep" / "out").iterdir())
    assert [file.name for file in files] == [f"{TRIAL}.json", f"{TRIAL}.yaml"]
    trajectory = trajectory_from_json(files[0].read_bytes(), str(files[0]))
    assert (trajectory.arm, trajectory.trial) == ("Kinova Gen3", TRIAL)
    assert np.array_equal(trajectory.cuts[0].positions, arm_events[1].motion.positions)
    (document,) = yaml.safe_load_all(files[1].read_bytes())
    assert len(document["points"]) == len(arm_events[1].motion.times)
    out, err = capsys.readouterr()
    assert out.splitlines() == [*map(str, files), "1 cuts, 3.9 s, 234 points of 2 joints", "limits: kept"]
    assert err == f"{TRIAL} is carried out again\n"


def test_the_ending_of_the_file_decides_what_is_written(arm_run, arm_events, carried_out, tmp_path):
    carried_out(arm_events)
    for name in ("a.json", "a.yaml", "a.yml"):
        assert export(ExportConfig(arm_run, TRIAL, out=tmp_path / name, rate=10.0)) == 0
    points = len(trajectory_from_json((tmp_path / "a.json").read_bytes()).cuts[0].times)
    assert 39 < points < 60
    (document,) = yaml.safe_load_all((tmp_path / "a.yaml").read_bytes())
    assert len(document["points"]) == points
    assert (tmp_path / "a.yml").read_bytes() == (tmp_path / "a.yaml").read_bytes()


def test_a_broken_limit_is_named_and_the_exit_code_is_2(arm_run, arm_events, carried_out, tmp_path, capsys):
    slow = dataclasses.replace(arm_events[1].motion, velocity_limits=np.array([0.5, 6.0]))
    carried_out([arm_events[0], dataclasses.replace(arm_events[1], motion=slow), arm_events[2]])
    assert main(["export", str(arm_run), TRIAL, "--out", str(tmp_path / "a.json"), "--rate", "5"]) == 2
    (told,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("limits")]
    assert re.fullmatch(
        r"limits: cut 1, shoulder: velocity -?\d\.\d{4} rad/s at \d\.\d{3} s is beyond its limit -?0\.5000 rad/s", told
    )
    assert (tmp_path / "a.json").exists()


def test_a_note_says_that_a_trial_came_out_differently(arm_run, arm_events, carried_out, tmp_path, capsys):
    carried_out([*arm_events[:2], Scored({"iou_strict": 0.25}, 2, 2, ())])
    export(ExportConfig(arm_run, TRIAL, out=tmp_path / "a.json"))
    assert "NOTE the result differs: strict IoU 0.250000, 1.000000 in the ledger" in capsys.readouterr().err


def test_what_cannot_be_exported_is_refused_before_any_work(arm_run, tmp_path, monkeypatch):
    monkeypatch.setattr(trial_trace, "worker_for", lambda *_: pytest.fail("a trial was carried out"))
    with pytest.raises(InputError, match=r"no arm moved in .*-bench-truth: its world is bench; .* --world kinova"):
        export(ExportConfig(arm_run, TRIAL.replace("kinova", "bench"), out=tmp_path / "a.json"))
    with pytest.raises(InputError, match=r"a\.txt is neither \.json, \.yaml nor a folder"):
        export(ExportConfig(arm_run, TRIAL, out=tmp_path / "a.txt"))
    with pytest.raises(ValueError, match="greater than 0"):
        export(ExportConfig(arm_run, TRIAL, out=tmp_path / "a.json", rate=0.0))
    with pytest.raises(InputError, match="the closest name is"):
        export(ExportConfig(arm_run, "N9", out=tmp_path / "a.json"))
    with pytest.raises(InputError, match="is not a run"):
        export(ExportConfig(tmp_path, TRIAL, out=tmp_path / "a.json"))


def test_a_trial_in_which_nothing_was_cut_is_refused(made, tmp_path):
    facts = made.facts_of()
    stuck = made.records_of(facts, setups=["N1M1"], methods=["random"], trials=1, runs=1)
    run = made.write_run(tmp_path / "stuck", facts, stuck, stuck)
    with pytest.raises(InputError, match=r"no cut was made in .* \(stuck: the planner saw"):
        export(ExportConfig(run, stuck[0].key.name, out=tmp_path / "a.json"))


def test_a_trial_that_no_longer_moves_an_arm_is_refused(arm_run, arm_events, carried_out, tmp_path):
    carried_out([arm_events[0], dataclasses.replace(arm_events[1], motion=None), arm_events[2]])
    with pytest.raises(InputError, match="no arm moved in .* when it was carried out again"):
        export(ExportConfig(arm_run, TRIAL, out=tmp_path / "a.json"))
