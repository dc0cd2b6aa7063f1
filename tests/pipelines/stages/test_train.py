import dataclasses
import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.learning.model import load_model
from cutgrammar.settings import CameraSettings, Settings, VisionSettings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.config import CollectConfig, SplitConfig, TrainConfig
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import MAX_MISSED, missed_first_cuts, train_repeatedly
from cutgrammar_pipelines.stages.train import train as train_as_in
from cutgrammar_pipelines.tracking.training_logs import training_log
from object_store import object_store, upload
from short_training import SHORT


def train(data, out, **options):
    return train_as_in(TrainConfig(data=data, out=out, **options))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("train") / "data"
    collect(CollectConfig(out=folder, trials=8, seed=4, setups=["N1M1"], workers=0))
    split(SplitConfig([folder], out=folder))
    return folder


@pytest.fixture(scope="module")
def model(data):
    train(data, data.parent / "model", settings=SHORT)
    return data.parent / "model"


def content(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_only_training_trials_are_learned_from(data, model):
    source = DataSet.open(data)
    chosen = read_split(source)
    found = load_model(model)
    assert found.provenance.trials == chosen.train
    assert found.provenance.data == source.digest
    assert found.provenance.split_digest == chosen.digest
    kept = [source.demonstration(trial) for trial in chosen.train]
    assert found.metrics["cuts"] == sum(len(demonstration.cuts) for demonstration in kept)


def test_the_same_training_again_does_nothing_and_says_so(data, model, capsys):
    before = content(model)
    assert train(data, model, settings=SHORT).learned is None
    assert "nothing to do" in capsys.readouterr().out
    assert content(model) == before


@pytest.mark.slow
def test_repetitions_are_the_same_wherever_they_are_trained_and_finished_ones_are_kept(data, model, tmp_path):
    def configs(folder):
        return [TrainConfig(data=data, out=tmp_path / folder / f"{i}", settings=SHORT, seed=i) for i in range(3)]

    trained = []
    train_repeatedly(configs("here"), trained.append, workers=0)
    assert [one.path.name for one in trained] == ["0", "1", "2"]
    assert content(tmp_path / "here" / "0") == content(model)
    shutil.copytree(tmp_path / "here" / "1", tmp_path / "there" / "1")
    trained.clear()
    train_repeatedly(configs("there"), trained.append, workers=2)
    assert trained[0].learned is None
    assert sorted(one.path.name for one in trained) == ["0", "1", "2"]
    for i in range(3):
        assert content(tmp_path / "there" / f"{i}") == content(tmp_path / "here" / f"{i}")


def test_training_warns_of_planes_that_miss_first_cuts_of_whole_objects(data, tmp_path, capsys):
    short = dataclasses.replace(SHORT, planes=dataclasses.replace(SHORT.planes, epochs=1))
    trained = train(data, tmp_path / "model", settings=short)
    missed = trained.model.metrics["planes_missed_first_cuts"]
    assert missed > MAX_MISSED
    assert (
        f"warning: the trained planes miss the demonstrated first cut of {missed:.0%} (grammar)"
        in capsys.readouterr().err
    )


def test_planes_that_meet_first_cuts_are_not_warned_of():
    assert missed_first_cuts(SimpleNamespace(metrics={"planes_missed_first_cuts": MAX_MISSED})) is None
    assert missed_first_cuts(SimpleNamespace(metrics={})) is None
    text = missed_first_cuts(
        SimpleNamespace(metrics={"planes_missed_first_cuts": 0.5, "goal_planes_missed_first_cuts": 0.3})
    )
    assert "50% (grammar) and 30% (bc, qnet) of the training trials' whole objects" in text


def test_another_training_does_not_overwrite_a_model(data, model):
    for other in ({"seed": 1}, {"settings": Settings()}):
        with pytest.raises(InputError, match="holds a model with (seed = 0, not 1|settings\\.)"):
            train(data, model, **{"settings": SHORT, **other})


def test_a_damaged_model_is_not_taken_for_finished(data, model, tmp_path):
    shutil.copytree(model, tmp_path / "damaged")
    (tmp_path / "damaged" / "planes.safetensors").write_bytes(b"")
    with pytest.raises(InputError, match=r"planes\.safetensors is damaged"):
        train(data, tmp_path / "damaged", settings=SHORT)


def test_other_files_in_the_way_are_kept(data, tmp_path):
    (tmp_path / "diary").write_text("dear")
    with pytest.raises(InputError, match="exists already"):
        train(data, tmp_path, settings=SHORT)
    assert content(tmp_path) == {"diary": b"dear"}


def test_an_unknown_split_is_refused_before_anything_is_made(data, tmp_path):
    with pytest.raises(InputError, match="no split 'mine'"):
        train(data, tmp_path / "model", settings=SHORT, split="mine")
    assert not list(tmp_path.iterdir())


def test_two_trainings_give_the_same_bytes(data, model, tmp_path):
    train(data, tmp_path / "again", settings=SHORT)
    assert content(tmp_path / "again") == content(model)


FEW_EPOCHS = """
[features]
epochs = 3
[classifier]
epochs = 20
[planes]
epochs = 20
[baselines]
epochs = 20
plane_epochs = 20
"""


@pytest.mark.slow
def test_two_trainings_of_full_size_give_the_same_bytes_in_any_process(data, tmp_path):
    settings = tmp_path / "few_epochs.toml"  # all sizes are those of a user
    settings.write_text(FEW_EPOCHS)
    for hash_seed, threads in (("1", "1"), ("2", "2")):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "OMP_NUM_THREADS": threads}
        code = "import sys; from cutgrammar_pipelines import TrainConfig, train;"
        code += "train(TrainConfig(data=sys.argv[1], out=sys.argv[2], settings=sys.argv[3]))"
        command = [sys.executable, "-c", code, str(data), str(tmp_path / hash_seed), str(settings)]
        subprocess.run(command, env=environment, check=True, capture_output=True)
    assert content(tmp_path / "1") == content(tmp_path / "2")


SEEING = dataclasses.replace(
    SHORT,
    cameras=CameraSettings(renderer="rays", width=160, height=120),
    vision=VisionSettings(n_scenes=3, epochs=2, hidden_size=8, n_message_rounds=1),
)


@pytest.mark.slow
def test_training_with_vision_adds_a_segmentation_and_changes_nothing_else(data, model, tmp_path, capsys):
    seen = train(data, tmp_path / "seen", settings=SEEING, vision=True)
    assert len(seen.learned.segmentation.losses) == 2
    found = load_model(tmp_path / "seen")
    assert found.segmentation.to_bytes() == seen.model.segmentation.to_bytes()
    now, before = content(tmp_path / "seen"), content(model)
    assert set(now) - set(before) == {"segmentation.safetensors"}
    assert all(now[name] == before[name] for name in before if name != "model.json")
    log = training_log(seen.path, found, seen.learned, data)
    assert [step for step, _ in log.curves["loss/segmentation"]] == [1, 2]
    capsys.readouterr()
    assert train(data, tmp_path / "seen", settings=SEEING, vision=True).learned is None
    assert "nothing to do" in capsys.readouterr().out
    with pytest.raises(InputError, match="holds a model with a segmentation; train without --vision into another"):
        train(data, tmp_path / "seen", settings=SEEING)


def test_a_model_without_a_segmentation_is_not_taken_for_one_with_it(data, model):
    with pytest.raises(InputError, match="holds a model with no segmentation; train with --vision into another --out"):
        train(data, model, settings=SHORT, vision=True)


def test_a_data_set_at_a_url_is_trained_on_and_split_into_a_folder(data, model, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CUTGRAMMAR_CACHE", str(tmp_path / "cache"))
    with object_store(monkeypatch):
        upload(data, "s3://lab/data")
        assert train("s3://lab/data", model, settings=SHORT).learned is None  # it is the same training
        assert "nothing to do" in capsys.readouterr().out
        split(SplitConfig(["s3://lab/data"], out=tmp_path / "here", rule="share", share=0.5))
        with pytest.raises(InputError, match="^s3://lab/nothing holds no files"):
            train("s3://lab/nothing", tmp_path / "model")
    assert content(tmp_path / "here" / "splits").keys() == {"share.json"}
    here, there = DataSet.open(tmp_path / "here"), DataSet.open(data)
    assert [one.fragments for one in here.trials] == [one.fragments for one in there.trials]
    log = training_log(model, load_model(model), None, "s3://lab/data")
    assert (log.params["data"].split()[0], log.inputs[0].path) == ("data", "s3://lab/data")
