"""A file of a stranger is an ordinary file of limited size, and what is written stays in its folder."""

import os
import socket

import pytest

from cutgrammar.errors import InputError
from cutgrammar.untrusted.files import check_inside, check_regular, open_lock, read_regular


def test_an_ordinary_file_is_read_whole_also_through_a_link(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    (tmp_path / "b").symlink_to("a")
    assert read_regular(tmp_path / "a", 3) == read_regular(tmp_path / "b", 3) == b"abc"


@pytest.mark.timeout(5)
@pytest.mark.parametrize("kind", ["named pipe", "folder", "socket", "device"])
def test_what_is_no_ordinary_file_is_refused_at_once(kind, tmp_path):
    path = tmp_path / "x"
    if kind == "named pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
    else:
        path.symlink_to("/dev/zero")
    with (
        pytest.raises(InputError, match=f"{path} is a {kind}")
        if kind != "socket"
        else pytest.raises((InputError, OSError))
    ):
        read_regular(path, 100)
    with pytest.raises(InputError, match=f"{path} is a {kind}"):
        check_regular(path)


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / "x").open("wb") as file:
        file.truncate(20 * 10**9)
    for read in (read_regular, check_regular):
        with pytest.raises(InputError, match="more than 5 MB"):
            read(tmp_path / "x", 5_000_000)


def test_a_missing_file_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "x", 1)


def test_writing_stays_in_its_folder(tmp_path):
    run, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    (run / "recordings").mkdir(parents=True)
    elsewhere.mkdir()
    (run / "linked").symlink_to(elsewhere)
    check_inside(run / "recordings" / "a.rrd", run)
    for name in ("linked/a.rrd", "recordings/../../a.rrd", ".."):
        with pytest.raises(InputError, match="is outside"):
            check_inside(run / name, run)


@pytest.mark.timeout(5)
def test_a_lock_is_neither_a_link_nor_a_pipe(tmp_path):
    with open_lock(tmp_path / "a.lock"), open_lock(tmp_path / "a.lock"):
        assert (tmp_path / "a.lock").is_file()
    (tmp_path / "b.lock").symlink_to(tmp_path / "new")
    os.mkfifo(tmp_path / "c.lock")
    for name in ("b.lock", "c.lock"):
        with pytest.raises(InputError, match=name):
            open_lock(tmp_path / name)
    assert not (tmp_path / "new").exists()
