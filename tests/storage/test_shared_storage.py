"""Folders at paths and at URLs of a store that speaks S3."""

import os
from pathlib import Path

import pytest
from pyarrow import fs

from cutgrammar.errors import InputError
from cutgrammar.storage import shared_storage
from cutgrammar.storage.shared_storage import absolute, check_url, local_folder, read_file, write_file
from object_store import names_at, object_store, upload


@pytest.fixture
def store(monkeypatch, tmp_path):
    monkeypatch.setenv("CUTGRAMMAR_CACHE", str(tmp_path / "cache"))
    with object_store(monkeypatch) as stop:
        yield stop


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "data" / "cuts").mkdir(parents=True)
    (tmp_path / "data" / "manifest.json").write_text("{}")
    (tmp_path / "data" / "cuts" / "part-00000.parquet").write_bytes(b"cuts")
    return tmp_path / "data"


def content(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_places_in_this_machines_file_system_are_used_as_they_are(folder):
    assert local_folder(folder) == local_folder(str(folder)) == local_folder(f"file://{folder}") == folder
    assert local_folder("nowhere") == Path("nowhere")
    assert absolute("s3://lab/data") == "s3://lab/data"
    assert absolute(folder / "..") == str(folder.parent)


def test_a_folder_is_fetched_once_and_anew_when_it_has_changed(store, folder, monkeypatch):
    upload(folder, "s3://lab/data")
    fetched = local_folder("s3://lab/data")
    assert content(fetched) == content(folder)
    with monkeypatch.context() as patch:
        patch.setattr(shared_storage.fs, "copy_files", lambda *_: pytest.fail("it is fetched a second time"))
        assert local_folder("s3://lab/data") == local_folder("s3://lab/data/") == fetched
    (folder / "splits").mkdir()
    (folder / "splits" / "paper.json").write_text("{}")
    upload(folder, "s3://lab/data")
    assert content(local_folder("s3://lab/data")) == content(folder)


def test_a_fetch_that_is_interrupted_leaves_nothing_behind(store, folder, monkeypatch):
    upload(folder, "s3://lab/data")
    copy = shared_storage.fs.copy_files

    def interrupted(*arguments):
        copy(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(shared_storage.fs, "copy_files", interrupted)
        with pytest.raises(KeyboardInterrupt):
            local_folder("s3://lab/data")
    assert content(local_folder("s3://lab/data")) == content(folder)


@pytest.mark.parametrize("kind", ["s3", "file", "path"])
def test_a_file_that_was_written_is_read_by_its_name(kind, store, tmp_path):
    places = {"s3": "s3://lab/recordings", "file": f"file://{tmp_path}/recordings", "path": f"{tmp_path}/recordings"}
    place = places[kind]
    assert read_file(place, "trial.rrd") is None
    write_file(place, "trial.rrd", b"first")
    write_file(place, "trial.rrd", b"second")
    assert read_file(place, "trial.rrd") == b"second"
    assert names_at("s3://lab/recordings") == (["trial.rrd"] if kind == "s3" else [])


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("nope://lab/data", "nope://lab/data cannot be used: Unrecognized filesystem type"),
        ("s3:///data", "Missing bucket name"),
        ("file://elsewhere/data", "Unsupported hostname"),
        ("s3://me:hidden-word@lab/data", "give the key by the environment"),
    ],
)
def test_a_url_that_cannot_be_one_is_refused_without_its_password(url, words):
    with pytest.raises(InputError, match=words) as refused:
        check_url(url)
    assert "hidden-word" not in str(refused.value)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("s3://lab/nothing", "s3://lab/nothing holds no files"),
        ("s3://other/data", "s3://other/data cannot be used: .*NO_SUCH_BUCKET|s3://other/data holds no files"),
    ],
)
def test_a_folder_that_is_not_there_is_told_in_one_line(url, words, store):
    with pytest.raises(InputError, match=words) as refused:
        local_folder(url)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_a_store_that_is_down_is_told_in_one_line(store):
    store()
    with pytest.raises(InputError, match=r"s3://lab/data cannot be used: .*Could not connect") as refused:
        local_folder("s3://lab/data")
    assert "\n" not in str(refused.value)


def test_no_object_leads_out_of_the_fetched_folder(store, tmp_path, monkeypatch):
    class Hostile:
        def get_file_info(self, _):
            return [fs.FileInfo("lab/data/../../escaped", type=fs.FileType.File, size=1, mtime_ns=1)]

    monkeypatch.setattr(shared_storage, "_open", lambda _: (Hostile(), "lab/data"))
    with pytest.raises(InputError, match="leads out of it"):
        local_folder("s3://lab/data")


def test_a_cache_that_others_can_write_into_is_not_used(store, folder, tmp_path):
    upload(folder, "s3://lab/data")
    (tmp_path / "cache").mkdir()
    os.chmod(tmp_path / "cache", 0o777)
    with pytest.raises(InputError, match="others can write into"):
        local_folder("s3://lab/data")
