import os

import pytest

from cutgrammar.atomic_files import atomic_folder, check_place, json_bytes, write_atomic
from cutgrammar.errors import InputError


def test_a_file_is_replaced_completely_and_no_temporary_file_remains(tmp_path):
    write_atomic(tmp_path / "a", b"one")
    write_atomic(tmp_path / "a", b"two")
    assert (tmp_path / "a").read_bytes() == b"two"
    assert os.listdir(tmp_path) == ["a"]
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o666 & ~_umask()


def test_a_folder_whose_filling_fails_leaves_nothing(tmp_path):
    def fill():
        with atomic_folder(tmp_path / "sub" / "out") as beside:
            (beside / "a").write_text("x")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill()
    assert os.listdir(tmp_path / "sub") == []


def test_a_folder_appears_at_the_end_of_the_block_and_may_replace_an_empty_one(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    with atomic_folder(out) as beside:
        (beside / "deep").mkdir()
        (beside / "deep" / "a").write_text("x")
        assert os.listdir(out) == []
    assert (out / "deep" / "a").read_text() == "x"
    assert os.listdir(tmp_path) == ["out"]
    assert out.stat().st_mode & 0o777 == 0o777 & ~_umask()


def test_a_folder_in_use_is_refused(tmp_path):
    (tmp_path / "a").write_text("x")
    with pytest.raises(InputError, match="exists already"), atomic_folder(tmp_path):
        pass
    with pytest.raises(InputError, match="exists already"), atomic_folder(tmp_path / "a"):
        pass
    with pytest.raises(InputError, match="cannot be made"), atomic_folder(tmp_path / "a" / "b"):
        pass


def test_equal_values_give_equal_bytes():
    assert json_bytes({"b": 1, "a": [1.5, "ö"]}) == json_bytes({"a": [1.5, "ö"], "b": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_bytes(float("nan"))


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_a_place_is_checked_without_a_trace_before_long_work(tmp_path):
    check_place(tmp_path / "new" / "model")
    assert list((tmp_path / "new").iterdir()) == []
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/model cannot be made: .*; choose another place with --out"):
        check_place(tmp_path / "file" / "model")
