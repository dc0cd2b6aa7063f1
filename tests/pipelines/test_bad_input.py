"""What a user can get wrong, by name: one line, exit code 2, nothing lost."""

import bz2
import json
import shutil

import numpy as np
import pytest
import trimesh

from cutgrammar_pipelines.cli.main import main

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def own_store(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")


@pytest.fixture
def data(data_folder, tmp_path):
    return shutil.copytree(data_folder, tmp_path / "data")


@pytest.fixture
def model(model_folder, tmp_path):
    return shutil.copytree(model_folder, tmp_path / "model")


@pytest.fixture
def check_refused(capsys):
    def check(words, *parts):
        capsys.readouterr()
        code = main([str(word) for word in words])
        error = capsys.readouterr().err.strip()
        assert code == 2, error
        line = error.splitlines()[-1]
        assert line.startswith(f"cutgrammar {words[0]}: ")
        for part in parts:
            assert str(part) in line
        assert "Traceback" not in error

    return check


def bad_mesh(kind, folder):
    box = trimesh.creation.box((0.05, 0.04, 0.03))
    path = folder / f"{kind}.stl"
    if kind == "open":
        box.update_faces(np.arange(len(box.faces)) > 2)
    elif kind == "overlapping":
        box = trimesh.util.concatenate([box, box.copy().apply_translation([0.02, 0.01, 0.007])])
    elif kind == "flat":
        box.vertices[:, 2] = 0
    elif kind == "gigantic":
        box.apply_scale(1000)
    elif kind == "not-a-number":
        path = folder / "not-a-number.obj"
        path.write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        return path
    elif kind == "empty":
        path.write_bytes(b"")
        return path
    elif kind == "bomb":
        path.write_bytes(bz2.compress(bytes(50_000_000)))
        return path
    elif kind == "archive":
        path = folder / "food.stl.bz2"
        path.write_bytes(bz2.compress(bytes(1000)))
        return path
    box.export(path)
    return path


@pytest.mark.parametrize(
    ("kind", "word"),
    [
        ("open", "open"),
        ("overlapping", "overlap"),
        ("flat", "flat"),
        ("gigantic", "--unit"),
        ("not-a-number", "NaN"),
        ("empty", "empty"),
        ("bomb", "archive"),
        ("archive", "archive"),
    ],
)
def test_a_bad_mesh_is_refused_with_its_reason(kind, word, tmp_path, check_refused):
    path = bad_mesh(kind, tmp_path)
    check_refused(["collect", "--out", tmp_path / "new", "--foods", path], path, word)
    assert not (tmp_path / "new").exists()


def test_a_torn_part_is_named(data, model, tmp_path, check_refused, quick_settings):
    part = data / "fragments" / "part-00000.parquet"
    part.write_bytes(part.read_bytes()[:-100])
    for command in (["show", data], ["train", "--data", data, "--out", tmp_path / "new"]):
        check_refused(command, "fragments/part-00000.parquet")
    check_refused(
        ["evaluate", "--data", data, "--model", model, "--out", tmp_path / "run"], "fragments/part-00000.parquet"
    )
    assert not (tmp_path / "run").exists()


def test_a_missing_part_is_named(data, check_refused):
    (data / "cuts" / "part-00000.parquet").unlink()
    check_refused(["show", data], "cuts/part-00000.parquet", "missing")


@pytest.mark.parametrize("name", ["data", "model"])
def test_another_schema_is_refused(name, data, model, tmp_path, check_refused):
    file = {"data": data / "manifest.json", "model": model / "model.json"}[name]
    file.write_text(json.dumps({**json.loads(file.read_text()), "schema": 99}))
    check_refused(["evaluate", "--data", data, "--model", model, "--out", tmp_path / "run"], "schema", 99)


def test_a_torn_model_is_refused(data, model, tmp_path, check_refused):
    weights = next(model.glob("*.safetensors"))
    weights.write_bytes(weights.read_bytes()[:-1])
    check_refused(["evaluate", "--data", data, "--model", model, "--out", tmp_path / "run"], weights.name)


@pytest.mark.parametrize(
    ("option", "value"),
    [("--methods", "gramar"), ("--setups", "N9M9"), ("--world", "moon")],
)
def test_unknown_names_are_answered_with_the_known(option, value, data, model, tmp_path, check_refused):
    words = ["evaluate", "--data", data, "--model", model, "--out", tmp_path / "run", option, value]
    known = {"--methods": "grammar, grammar-plus, guided", "--setups": "N1M1, N1M2", "--world": "bench, board, kinova"}[
        option
    ]
    check_refused(words, value, known)


def test_a_run_of_another_seed_is_not_mixed_in(data, model, tmp_path, check_refused, quick_settings):
    words = ["evaluate", "--data", data, "--model", model, "--out", tmp_path / "run", "--methods", "random"]
    words += ["--setups", "N1M1", "--trials", 1, "--runs", 1, "--world", "bench", "--workers", 0]
    assert main([str(word) for word in words]) == 0
    check_refused([*words, "--seed", 7], "seed", 0, 7)
    assert main([str(word) for word in words]) == 0


def test_a_split_that_names_unknown_trials_is_refused(data, check_refused):
    file = data / "splits" / "paper.json"
    facts = json.loads(file.read_text())
    facts["test"] = [*facts["test"], 9999]
    file.write_text(json.dumps(facts))
    check_refused(["train", "--data", data, "--out", data.parent / "new"], "paper", 9999)
