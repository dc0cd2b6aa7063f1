"""A trial that the arm carries out is recorded, described, exported and drawn."""

import pytest
import yaml
from PIL import Image
from rerun.chunk import RrdReader

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, recording_of
from cutgrammar.trials.trajectory import trajectory_from_json
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.evaluate import evaluate


@pytest.fixture(scope="module")
def run(data_folder, model_folder, quick_settings, tmp_path_factory):
    """A run of one trial, carried out by the arm and recorded."""
    folder = tmp_path_factory.mktemp("arm") / "run"
    folders = {"data": data_folder, "model": model_folder, "out": folder}
    one = {"methods": ["replay"], "setups": ["N1M1"], "runs": 1, "trials": 1, "world": "kinova", "record": "all"}
    evaluate(EvaluateConfig(**folders, **one, workers=0, settings=quick_settings))
    return folder


@pytest.mark.slow
def test_the_arm_is_in_the_recording(run):
    (record,) = read_records(ledger_of(run))
    entities = {chunk.entity_path for chunk in RrdReader(str(recording_of(run, record.key.name))).stream()}
    assert {"/blade/path", "/motion/torque", "/motion/phase"} <= entities
    parts = {entity.rsplit("/", 1)[1] for entity in entities if entity.startswith("/arm/")}
    assert {"blade", "forearm"} <= parts


@pytest.mark.slow
def test_the_trial_is_exported_as_it_was_carried_out_and_keeps_the_limits(run, tmp_path, capsys):
    (record,) = read_records(ledger_of(run))
    assert main(["export", str(run), record.key.name, "--out", str(tmp_path), "--rate", "10"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "limits: kept"
    assert "NOTE" not in err
    trajectory = trajectory_from_json((tmp_path / f"{record.key.name}.json").read_bytes())
    assert (trajectory.arm, trajectory.joints[0], len(trajectory.cuts)) == ("Kinova Gen3", "joint_1", record.cuts)
    seconds = [event["execution"]["seconds"] for event in record.events if event["event"] == "CutMade"]
    assert [cut.times[-1] for cut in trajectory.cuts] == seconds
    for before, after in zip(trajectory.cuts, trajectory.cuts[1:], strict=False):
        assert abs(before.positions[-1] - after.positions[0]).max() < 0.01
    documents = list(yaml.safe_load_all((tmp_path / f"{record.key.name}.yaml").read_bytes()))
    assert len(documents) == record.cuts


@pytest.mark.slow
def test_key_frames_are_drawn_and_show_describes_the_arm(run, tmp_path, capsys):
    (record,) = read_records(ledger_of(run))
    assert main(["film", str(run), record.key.name, "--stills", str(tmp_path / "keys.png")]) == 0
    with Image.open(tmp_path / "keys.png") as keys:
        assert keys.width == 1280
    assert main(["show", str(run)]) == 0
    assert f"arm of kinova, truth, replay: {record.cuts} cuts in" in capsys.readouterr().out
