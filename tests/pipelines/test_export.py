"""What an arm did in a trial is written for a real one, with a line for every limit that it did not keep."""

import dataclasses
import re

import numpy as np
import pytest
import trimesh
import yaml

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.seams import Cut, CutMade, Execution, Planned, Scored
from cutgrammar.trials.record import record_of
from cutgrammar.trials.trajectory import from_json
from cutgrammar_pipelines import one_trial
from cutgrammar_pipelines.command_line import main
from cutgrammar_pipelines.export import export
from cutgrammar_workers.world_actor import Story

TRIAL = "N1M1-0-in-place-grammar-0-kinova-truth"


def block(x):
    mesh = trimesh.creation.box((0.04, 0.03, 0.02))
    return Fragment(Mesh(mesh.vertices, mesh.faces), Pose(np.eye(3), np.array([x, 0.0, 0.01])))


@pytest.fixture
def events(make_motion):
    one, two = (block(0.0),), (block(-0.02), block(0.02))
    cut = Cut(Plane(np.array([1.0, 0, 0]), 0.0), np.zeros((1, 3)))
    how = Execution(None, 0.0, 0.0, 0.01, 0.02, 4.0, 25.0, 0.6, 0.4, True)
    motion = make_motion(one, two, np.zeros(3), hertz=60)
    return [Planned(1, 0, cut, 0.1), CutMade(1, 2, two, how, motion), Scored(1.0, 1.0, 2, 2, ())]


@pytest.fixture
def run(made, tmp_path, events):
    """A run of two trials, one by an arm and one on the bench."""
    facts = made.facts_of()
    bench = made.records_of(facts, setups=["N1M1"], methods=["grammar"], trials=1, runs=1)[0]
    arm = record_of(dataclasses.replace(bench.key, world="kinova"), events, package="0.1.0", seconds=1.0)
    cut = {"event": "CutMade", "step": 1, "products": 2, "fragments": 2}
    records = [arm, dataclasses.replace(bench, events=(cut,))]
    return made.write_run(tmp_path / "run", facts, records, records)


@pytest.fixture
def carried_out(monkeypatch, run):
    """Makes the given events what happens when a trial is carried out again."""

    def give(events):
        def once_more(folder, keys):
            record = record_of(keys[0], events, package="0.1.0", seconds=2.0)
            start = events[1].motion.phases[0].fragments if events[1].motion else ()
            return TellerOf(Story(start, events[1].configuration, tuple(events), record)), [keys[0]]

        monkeypatch.setattr(one_trial, "once_more", once_more)

    return give


class TellerOf:
    def __init__(self, told):
        self._told = told

    def story(self, job):
        return self._told


def test_a_folder_gets_both_files_named_by_the_trial(run, events, carried_out, tmp_path, capsys):
    carried_out(events)
    assert export(run, "N1M1-0-in-place-grammar-0-kin", tmp_path / "deep" / "out") == 0
    files = sorted((tmp_path / "deep" / "out").iterdir())
    assert [file.name for file in files] == [f"{TRIAL}.json", f"{TRIAL}.yaml"]
    trajectory = from_json(files[0].read_bytes(), str(files[0]))
    assert (trajectory.arm, trajectory.trial) == ("Kinova Gen3", TRIAL)
    assert np.array_equal(trajectory.cuts[0].positions, events[1].motion.positions)
    (document,) = yaml.safe_load_all(files[1].read_bytes())
    assert len(document["points"]) == len(events[1].motion.times)
    out, err = capsys.readouterr()
    assert out.splitlines() == [*map(str, files), "1 cuts, 3.9 s, 234 points of 2 joints", "limits: kept"]
    assert err == f"{TRIAL} is carried out again\n"


def test_the_ending_of_the_file_decides_what_is_written(run, events, carried_out, tmp_path):
    carried_out(events)
    for name in ("a.json", "a.yaml", "a.yml"):
        assert export(run, TRIAL, tmp_path / name, rate=10.0) == 0
    points = len(from_json((tmp_path / "a.json").read_bytes()).cuts[0].times)
    assert 39 < points < 60
    (document,) = yaml.safe_load_all((tmp_path / "a.yaml").read_bytes())
    assert len(document["points"]) == points
    assert (tmp_path / "a.yml").read_bytes() == (tmp_path / "a.yaml").read_bytes()


def test_a_broken_limit_is_named_and_the_exit_code_is_2(run, events, carried_out, tmp_path, capsys):
    slow = dataclasses.replace(events[1].motion, velocity_limits=np.array([0.5, 6.0]))
    carried_out([events[0], dataclasses.replace(events[1], motion=slow), events[2]])
    assert main(["export", str(run), TRIAL, "--out", str(tmp_path / "a.json"), "--rate", "5"]) == 2
    (told,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("limits")]
    assert re.fullmatch(
        r"limits: cut 1, shoulder: velocity -?\d\.\d{4} rad/s at \d\.\d{3} s is beyond its limit -?0\.5000 rad/s", told
    )
    assert (tmp_path / "a.json").exists()


def test_a_trial_that_comes_out_differently_is_said_to(run, events, carried_out, tmp_path, capsys):
    carried_out([*events[:2], Scored(0.25, 0.25, 2, 2, ())])
    export(run, TRIAL, tmp_path / "a.json")
    assert "NOTE it came out differently: strict IoU 0.250000, 1.000000 in the ledger" in capsys.readouterr().err


def test_what_cannot_be_exported_is_refused_before_any_work(run, tmp_path, monkeypatch):
    monkeypatch.setattr(one_trial, "once_more", lambda *_: pytest.fail("a trial was carried out"))
    with pytest.raises(InputError, match=r"no arm moved in .*-bench-truth: its world is bench; .* --world kinova"):
        export(run, TRIAL.replace("kinova", "bench"), tmp_path / "a.json")
    with pytest.raises(InputError, match=r"a\.txt is neither \.json, \.yaml nor a folder"):
        export(run, TRIAL, tmp_path / "a.txt")
    with pytest.raises(InputError, match="--rate 0 is too small"):
        export(run, TRIAL, tmp_path / "a.json", rate=0.0)
    with pytest.raises(InputError, match="the closest name is"):
        export(run, "N9", tmp_path / "a.json")
    with pytest.raises(InputError, match="is not a run"):
        export(tmp_path, TRIAL, tmp_path / "a.json")


def test_a_trial_in_which_nothing_was_cut_is_refused(made, tmp_path):
    facts = made.facts_of()
    stuck = made.records_of(facts, setups=["N1M1"], methods=["random"], trials=1, runs=1)
    run = made.write_run(tmp_path / "stuck", facts, stuck, stuck)
    with pytest.raises(InputError, match=r"no cut was made in .* \(stuck: the planner saw"):
        export(run, stuck[0].key.name, tmp_path / "a.json")


def test_a_trial_that_no_longer_moves_an_arm_is_refused(run, events, carried_out, tmp_path):
    carried_out([events[0], dataclasses.replace(events[1], motion=None), events[2]])
    with pytest.raises(InputError, match="no arm moved in .* when it was carried out again"):
        export(run, TRIAL, tmp_path / "a.json")
