"""Folders and files at URLs: an object store such as S3, or whatever else Arrow opens (`pyarrow.fs`).

A place is a path, or a URL such as `s3://bucket/folder`. Where it is in this machine's file system (paths, `file://`),
it is used as it is. Otherwise a folder is fetched once a node: into a cache of this user, under a name that follows
from the sizes and times of its files, so that a changed folder is fetched anew.
"""

import fcntl
import hashlib
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

from pyarrow import ArrowException, fs

from cutgrammar.atomic_files import atomic_folder, write_atomic
from cutgrammar.errors import InputError

CACHE = "CUTGRAMMAR_CACHE"
"""Environment variable with the folder of what is fetched; by default a folder of the temporary ones."""


def is_url(place: str | Path) -> bool:
    """Whether a place is a URL and not a path."""
    return isinstance(place, str) and "://" in place


def absolute(place: str | Path) -> str:
    """A place by which it is found from everywhere."""
    return str(place) if is_url(place) else str(Path(place).resolve())


def check_url(place: str) -> str:
    """The place itself, after a check of its form.

    Raises:
        InputError: Arrow knows no such URL, or it holds a password, which would be printed and stored.
    """
    if is_url(place):
        _open(place)
    return place


def local_folder(place: str | Path) -> Path:
    """The folder at a place, as a folder of this machine.

    Raises:
        InputError: it cannot be fetched. A path that does not exist is returned as it is.
    """
    if not is_url(place):
        return Path(place)
    files, root = _open(str(place))
    if isinstance(files, fs.LocalFileSystem):
        return Path(root)
    with _told(str(place)):
        found = files.get_file_info(fs.FileSelector(root, recursive=True, allow_not_found=True))
    listed = sorted((_inner(info.path, root), info.size, info.mtime_ns) for info in found if info.is_file)
    if not listed:
        raise InputError(f"{place} holds no files; see whether it exists and can be read by you")
    wanted = _cache() / hashlib.sha256(json.dumps([str(place).rstrip("/"), listed]).encode()).hexdigest()[:32]
    with wanted.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not wanted.exists():
            with atomic_folder(wanted) as beside, _told(str(place)):
                fs.copy_files(root, str(beside), files, fs.LocalFileSystem())
    return wanted


def write_file(folder: str, name: str, content: bytes) -> None:
    """Write a file into the folder at a place, where it appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    files, root = _open(folder) if is_url(folder) else (fs.LocalFileSystem(), folder)
    if isinstance(files, fs.LocalFileSystem):
        Path(root).mkdir(parents=True, exist_ok=True)
        write_atomic(Path(root) / name, content)
        return
    with files.open_output_stream(f"{root}/{name}") as stream:  # an object appears when it is complete
        stream.write(content)


def read_file(folder: str, name: str) -> bytes | None:
    """The content of a file in the folder at a place; None if there is none.

    Raises:
        InputError: the place cannot be read.
    """
    files, root = _open(folder) if is_url(folder) else (fs.LocalFileSystem(), folder)
    with _told(folder):
        if not files.get_file_info(f"{root}/{name}").is_file:
            return None
        with files.open_input_stream(f"{root}/{name}") as stream:
            return bytes(stream.read())


def remove_file(folder: str, name: str) -> None:
    """Remove a file of the folder at a place, if it is there.

    Raises:
        InputError: it cannot be removed.
    """
    files, root = _open(folder) if is_url(folder) else (fs.LocalFileSystem(), folder)
    with _told(folder):
        if files.get_file_info(f"{root}/{name}").is_file:
            files.delete_file(f"{root}/{name}")


def _open(url: str) -> tuple[fs.FileSystem, str]:
    """The file system of a URL, and the path in it.

    Raises:
        InputError: there is none.
    """
    parts = urlsplit(url)
    if parts.username or parts.password:
        shown = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
        raise InputError(f"{shown}: give the key by the environment (AWS_ACCESS_KEY_ID ...), not within the URL")
    with _told(url):
        files, root = fs.FileSystem.from_uri(url)
    return files, root.rstrip("/")


@contextmanager
def _told(place: str) -> Iterator[None]:
    """Turn Arrow's errors into an `InputError` of one line."""
    try:
        yield
    except (OSError, ArrowException, NotImplementedError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(f"{place} cannot be used: {reason}") from error


def _inner(path: str, root: str) -> str:
    """The path of a file relative to its folder.

    Raises:
        InputError: it leads out of the folder.
    """
    inner = path.removeprefix(f"{root}/")
    if inner == path or not inner or {"", ".", ".."} & set(inner.split("/")) or PurePosixPath(inner).is_absolute():
        raise InputError(f"{root} holds a file {path!r}, which leads out of it")
    return inner


def _cache() -> Path:
    """The folder of what is fetched, of this user only.

    Raises:
        InputError: it cannot be made, or others can write into it.
    """
    folder = Path(os.environ.get(CACHE) or Path(tempfile.gettempdir()) / f"cutgrammar-{os.getuid()}")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        facts = folder.lstat()
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}); choose another folder with {CACHE}") from None
    if not stat.S_ISDIR(facts.st_mode) or facts.st_uid != os.getuid() or facts.st_mode & 0o022:
        raise InputError(f"others can write into {folder}; remove it, or choose another folder with {CACHE}")
    return folder
