import dataclasses
import json
import pickle
import shutil

import numpy as np
import pandas
import pyarrow.parquet as pq
import pytest

from cutgrammar.errors import InputError
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.storage import data_set
from cutgrammar.storage.data_set import DataSet, merge, new_data_set, write_data_set
from cutgrammar.storage.stored_demonstrations import StoredDemonstrations
from cutgrammar.storage.tables import SCHEMAS

SETTINGS = DemonstratorSettings()


@pytest.fixture
def several(demonstrate):
    return [demonstrate(trial, cuts=1 + trial % 2, seed=7) for trial in (0, 1, 2, 50, 51, 103)]


@pytest.fixture
def data(several, tmp_path):
    write_data_set(tmp_path / "data", several, SETTINGS, 7)
    return tmp_path / "data"


def files(folder):
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def assert_same(a, b):
    for name in ("trial", "setup", "foods", "categories", "demonstrator", "seed"):
        assert getattr(a, name) == getattr(b, name)
    for x, y in zip(a.fragments, b.fragments, strict=True):
        assert (x.id, x.parent, x.step, x.category) == (y.id, y.parent, y.step, y.category)
        assert np.array_equal(x.mesh.vertices, y.mesh.vertices)
        assert np.array_equal(x.mesh.faces, y.mesh.faces)
    assert a.poses.keys() == b.poses.keys()
    for key, X in a.poses.items():
        assert np.abs(X.to_vector() - b.poses[key].to_vector()).max() <= 1e-15
    for x, y in zip(a.cuts, b.cuts, strict=True):
        assert (x.step, x.fragment, x.products, x.undone) == (y.step, y.fragment, y.products, y.undone)
        for plane in ("plane_W", "plane_C"):
            assert np.abs(getattr(x, plane).to_vector() - getattr(y, plane).to_vector()).max() <= 1e-15


def test_demonstrations_survive_writing_and_reading(data, several):
    opened = DataSet.open(data)
    assert [summary.trial for summary in opened.trials] == [0, 1, 2, 50, 51, 103]
    assert opened.missing == ()
    assert (opened.seed, opened.settings) == (7, dataclasses.asdict(SETTINGS))
    for demonstration in several:
        assert_same(opened.demonstration(demonstration.trial), demonstration)
        summary = opened.summary(demonstration.trial)
        assert summary.fragments == len(demonstration.goal)
        assert summary.cuts == len(demonstration.cuts)


def test_undone_cuts_are_kept_but_not_counted(demonstrate, tmp_path):
    demonstration = demonstrate(cuts=9)
    write_data_set(tmp_path / "data", [demonstration], SETTINGS, 7)
    opened = DataSet.open(tmp_path / "data")
    assert [cut.undone for cut in opened.demonstration(0).cuts] == [False] * 8 + [True]
    assert opened.summary(0).cuts == 8


def test_the_same_demonstrations_give_the_same_bytes(data, several, tmp_path):
    write_data_set(tmp_path / "again", iter(several), SETTINGS, 7)
    assert files(tmp_path / "again") == files(data)
    assert DataSet.open(tmp_path / "again").digest == DataSet.open(data).digest


def test_the_number_of_a_trial_determines_its_part(data):
    manifest = json.loads((data / "manifest.json").read_text())
    assert [(p["number"], p["trials"]) for p in manifest["parts"]] == [(0, [0, 1, 2]), (1, [50, 51]), (2, [103])]


def test_standard_parquet_readers_can_read_the_tables(data, several):
    fragments = pandas.read_parquet(data / "fragments")
    assert len(fragments) == sum(len(d.fragments) for d in several)
    assert np.array_equal(np.stack(fragments.vertices[0]), several[0].fragments[0].mesh.vertices)
    cuts = pandas.read_parquet(data / "cuts")
    assert np.stack(cuts.plane_W).shape == (len(cuts), 4)
    assert np.stack(pandas.read_parquet(data / "poses").X_WF).shape[1] == 7
    assert list(pandas.read_parquet(data / "trials").trial) == [0, 1, 2, 50, 51, 103]


def test_an_interrupted_write_leaves_no_data_set(several, tmp_path):
    def broken():
        with new_data_set(tmp_path / "data", SETTINGS, 7) as add:
            add(several[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert list(tmp_path.iterdir()) == []


def test_unordered_or_missing_trials_are_refused(several, tmp_path):
    with pytest.raises(ValueError, match="trial 0 came after trial 1"):
        write_data_set(tmp_path / "data", [several[1], several[0]], SETTINGS, 7)
    with pytest.raises(ValueError, match="at least one"):
        write_data_set(tmp_path / "data", [], SETTINGS, 7)


def test_an_existing_folder_is_not_overwritten(data, several):
    before = files(data)
    with pytest.raises(InputError, match="exists already"):
        write_data_set(data, several, SETTINGS, 7)
    assert files(data) == before


# --- damage -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("table", SCHEMAS)
def test_a_damaged_part_is_refused_by_name_or_skipped(data, table):
    part = data / table / "part-00001.parquet"
    part.write_bytes(part.read_bytes()[:-7])
    with pytest.raises(
        InputError, match=rf"{table}/part-00001.parquet is damaged or foreign.*2 trials.*--allow-missing"
    ):
        DataSet.open(data)
    opened = DataSet.open(data, allow_missing=True)
    assert opened.missing == (50, 51)
    assert [summary.trial for summary in opened.trials] == [0, 1, 2, 103]
    assert opened.demonstration(103).trial == 103
    with pytest.raises(InputError, match="trial 50 is in a part that is missing or damaged"):
        opened.demonstration(50)


def test_a_missing_part_is_refused_by_name_or_skipped(data):
    (data / "cuts" / "part-00000.parquet").unlink()
    with pytest.raises(InputError, match="cuts/part-00000.parquet is missing"):
        DataSet.open(data)
    assert DataSet.open(data, allow_missing=True).missing == (0, 1, 2)
    shutil.rmtree(data / "cuts")
    with pytest.raises(InputError, match="cuts/part-00000.parquet is missing"):
        DataSet.open(data)
    with pytest.raises(InputError, match="no readable trial"):
        DataSet.open(data, allow_missing=True)


def test_a_foreign_part_is_refused_by_name_or_ignored(data):
    shutil.copy(data / "cuts" / "part-00000.parquet", data / "cuts" / "part-00007.parquet")
    with pytest.raises(InputError, match="cuts/part-00007.parquet is foreign"):
        DataSet.open(data)
    assert DataSet.open(data, allow_missing=True).missing == ()


def test_exchanged_parts_are_refused(data):
    shutil.copy(data / "cuts" / "part-00000.parquet", data / "cuts" / "part-00001.parquet")
    with pytest.raises(InputError, match="cuts/part-00001.parquet is damaged or foreign"):
        DataSet.open(data)


def test_a_part_with_other_rows_and_a_matching_digest_is_refused(data):
    """The manifest's digest has been changed to match."""
    shutil.copy(data / "cuts" / "part-00000.parquet", data / "cuts" / "part-00001.parquet")
    manifest = json.loads((data / "manifest.json").read_text())
    manifest["parts"][1]["sha256"]["cuts"] = manifest["parts"][0]["sha256"]["cuts"]
    (data / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"trial of a row is another one among those of trial 50"):
        DataSet.open(data).demonstration(50)
    shutil.copy(data / "poses" / "part-00000.parquet", data / "cuts" / "part-00001.parquet")
    manifest["parts"][1]["sha256"]["cuts"] = manifest["parts"][0]["sha256"]["poses"]
    (data / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"cuts/part-00001.parquet cannot be used \(its columns are not those"):
        DataSet.open(data).demonstration(50)


def test_another_schema_version_is_refused(data):
    manifest = json.loads((data / "manifest.json").read_text())
    (data / "manifest.json").write_text(json.dumps(manifest | {"schema": 2, "cutgrammar": "9.1"}))
    with pytest.raises(InputError, match="has schema 2, written by cutgrammar 9.1; this version reads schema 1"):
        DataSet.open(data)


@pytest.mark.parametrize("content", ["", "{", "[]", "3", '{"schema": 1}', '{"schema": "x"}', "\udcff"])
def test_a_damaged_manifest_is_refused(data, content):
    (data / "manifest.json").write_bytes(content.encode(errors="surrogateescape"))
    with pytest.raises(InputError, match=r"manifest\.json is"):
        DataSet.open(data)


def test_other_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist; make one with cutgrammar collect"):
        DataSet.open(tmp_path / "nowhere")
    with pytest.raises(InputError, match="is not a data set: it has no manifest.json"):
        DataSet.open(tmp_path)
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is not a data set"):
        DataSet.open(tmp_path / "file")


def test_an_unknown_trial_is_refused(data):
    with pytest.raises(InputError, match="has no trial 9; its 6 trials are numbered 0 to 103"):
        DataSet.open(data).demonstration(9)


# --- merging ----------------------------------------------------------------------------------------------------------


def test_merging_only_renumbers_the_trials(data, demonstrate, tmp_path):
    other = [demonstrate(trial, seed=8, foods=("carrot",)) for trial in range(3)]
    write_data_set(tmp_path / "other", other, SETTINGS, 8)
    sets = [DataSet.open(data), DataSet.open(tmp_path / "other")]
    merge(sets, tmp_path / "both")
    both = DataSet.open(tmp_path / "both")
    assert [s.trial for s in both.trials] == list(range(9))
    assert [s.seed for s in both.trials] == [7] * 6 + [8] * 3
    assert (both.seed, both.settings) == (None, None)
    assert_same(both.demonstration(5), dataclasses.replace(sets[0].demonstration(103), trial=5))
    assert_same(both.demonstration(8), dataclasses.replace(sets[1].demonstration(2), trial=8))
    for table in ("fragments", "poses", "cuts"):
        merged, own = both.tables(5)[table], sets[0].tables(103)[table]
        assert merged.drop_columns("trial").equals(own.drop_columns("trial")), "bits must not change"
    sources = json.loads((tmp_path / "both" / "manifest.json").read_text())["sources"]
    assert [(s["digest"], s["seed"], s["trials"]) for s in sources] == [(sets[0].digest, 7, 6), (sets[1].digest, 8, 3)]


def test_a_trial_is_read_without_the_others(data, monkeypatch):
    opened = DataSet.open(data)
    read = []
    monkeypatch.setattr(
        data_set,
        "read_group",
        lambda path, table, group: read.append((path.name, group)) or pq.ParquetFile(path).read_row_group(group),
    )
    opened.demonstration(51)
    assert set(read) == {("part-00001.parquet", 1)}


def test_stored_demonstrations_are_read_when_they_are_asked_for(data, several, monkeypatch):
    read = []
    original = DataSet.demonstration
    monkeypatch.setattr(DataSet, "demonstration", lambda self, trial: read.append(trial) or original(self, trial))
    stored = StoredDemonstrations(DataSet.open(data), [2, 50, 103])
    assert (len(stored), read) == (3, [])
    assert stored[1] is stored[1]
    assert [one.trial for one in stored[1:]] == [50, 103]
    assert read == [50, 50, 103]
    sent = pickle.dumps(stored)
    assert len(sent) < 5000
    assert_same(pickle.loads(sent)[2], several[5])
