"""Data sets that are wrong though their digests are right: refused by trial and part, never scored.

Each fault is signed anew, as whoever edits a data set by hand would do it. The evaluation ends with exit code 2, and
the folder of the run keeps what was there before.
"""

import shutil

import numpy as np
import pytest

from cutgrammar.learning.model import save_model
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.storage.split import make_split, write_split
from cutgrammar_pipelines.cli.main import main
from hostile.table_cases import change_rows
from untrained_model import untrained

TRIAL = 3
"""The trial that is spoiled; it is the second of two that are evaluated."""


def cell(table, row, **values):
    return table, lambda rows: rows[row].update(values)


def mesh(change):
    def spoil(rows):
        vertices, faces = np.array(rows[0]["vertices"]), np.array(rows[0]["faces"])
        vertices, faces = change(vertices, faces)
        rows[0].update(vertices=vertices.tolist(), faces=faces.tolist())

    return "fragments", spoil


def doubled(vertices, faces):
    """A mesh with each face twice, of which one is turned: closed by its edges, without a volume."""
    return vertices, np.concatenate([faces, faces[:, ::-1]])


FAULTS = {
    "an open mesh": mesh(lambda vertices, faces: (vertices, faces[1:])),
    "a mesh inside out": mesh(lambda vertices, faces: (vertices, faces[:, ::-1])),
    "a flat mesh": mesh(lambda vertices, faces: (vertices * [1, 1, 0], faces)),
    "a mesh without a volume": mesh(doubled),
    "a mesh without faces": mesh(lambda vertices, faces: (vertices, faces[:0])),
    "a vertex that is no number": mesh(lambda vertices, faces: (vertices * np.nan, faces)),
    "a mesh in millimetres": mesh(lambda vertices, faces: (vertices * 1e4, faces)),
    "a face of a vertex that there is not": mesh(lambda vertices, faces: (vertices[:-1], faces)),
    "a missing fragment": ("fragments", lambda rows: rows[:-1]),
    "a parent that there is not": cell("fragments", -1, parent=77),
    "a category that there is not": cell("fragments", -1, category="bricks"),
    "a missing pose": ("poses", lambda rows: rows[1:]),
    "a last step without poses": (
        "poses",
        lambda rows: [row for row in rows if row["step"] < max(other["step"] for other in rows)],
    ),
    "a pose of a fragment that was cut": ("poses", lambda rows: [*rows, {**rows[-1], "fragment": 0}]),
    "a pose that is no number": cell("poses", -1, X_WF=[np.nan] * 7),
    "a rotation of length 0": cell("poses", -1, X_WF=[0.0] * 7),
    "a cut of an unknown fragment": cell("cuts", 0, fragment=99),
    "products that there are not": cell("cuts", 0, products=[98, 99]),
    "a missing cut": ("cuts", lambda rows: rows[1:]),
    "a cut undone that was not": cell("cuts", -1, undone=True),
    "a plane without a direction": cell("cuts", 0, plane_W=[0.0] * 4),
    "rows of another trial": cell("poses", 0, trial=TRIAL - 1),
    "another number of fragments": cell("trials", 0, fragments=1),
    "another number of cuts": cell("trials", 0, cuts=0),
    "more foods than objects": cell("trials", 0, foods=["block", "block", "block"]),
}
EVALUATE = "evaluate --data {0}/data --model {0}/model --out {0}/run --methods random --world bench --runs 1 --quiet"


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """A folder with a data set of four trials, a split that tests the last two, and a model."""
    folder = tmp_path_factory.mktemp("given")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder / 'mlflow.db'}")
        words = "collect --trials 4 --setups N1M1 --foods block --seed 3 --workers 0 --quiet"
        assert main([*words.split(), "--out", str(folder / "data")]) == 0
    data = DataSet.open(folder / "data")
    split = make_split(data, "share", share=0.5)
    split = type(split)(split.name, split.rule, (0, 1), (2, TRIAL))
    write_split(data, split)
    save_model(untrained(data, split), folder / "model")
    return folder


@pytest.fixture
def place(given, tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    return shutil.copytree(given, tmp_path / "here")


def evaluate(place, *more):
    return main([*EVALUATE.format(place).split(), "--split", "share", "--workers", "0", *more])


def spoil(place, fault):
    """Make a fault, and sign the data set and its split anew."""
    table, change = FAULTS[fault]
    change_rows(place, table, change, TRIAL)


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_data_are_refused_by_trial_and_part(fault, place, capsys):
    spoil(place, fault)
    assert evaluate(place) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("cutgrammar evaluate: ")]
    assert f"trial {TRIAL}" in line or "row 3" in line, line
    assert "part-00000.parquet" in line, line
    ledger = ledger_of(place / "run")
    assert not ledger.exists() or TRIAL not in {record.key.trial for record in read_records(ledger)}


def test_a_run_of_good_data_keeps_every_byte_when_the_data_turn_bad(place):
    assert evaluate(place, "--trials", "1") == 0
    before = {file: file.read_bytes() for file in sorted((place / "run").rglob("*")) if file.is_file()}
    spoil(place, "an open mesh")
    assert evaluate(place) == 2
    assert {file: file.read_bytes() for file in sorted((place / "run").rglob("*")) if file.is_file()} == before


def test_what_was_scored_before_the_bad_trial_stays_and_can_be_reported(place, capsys):
    spoil(place, "an open mesh")
    assert evaluate(place) == 2
    assert [record.key.trial for record in read_records(ledger_of(place / "run"))] == [2]
    capsys.readouterr()
    assert main(["show", str(place / "run")]) in (0, 1)
    assert "1 of 2" in capsys.readouterr().out


@pytest.mark.parametrize("fault", ["an open mesh", "a missing pose", "products that there are not"])
def test_no_model_is_trained_from_bad_data(fault, place, capsys):
    table, change = FAULTS[fault]
    change_rows(place, table, change, 0)
    words = f"train --data {place}/data --split share --out {place}/new --quiet"
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert "trial 0" in error
    assert "part-00000.parquet" in error
    assert not (place / "new").exists()
