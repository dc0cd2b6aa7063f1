"""Files and folders that exist whole or not at all: written under a temporary name, fsynced, renamed."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cutgrammar.errors import InputError


def write_atomic(path: Path, content: bytes) -> None:
    """Write or replace a file; a reader finds either the old content or the new, never a part."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.partial-", dir=path.parent)
    beside = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            os.fchmod(file.fileno(), _mode(0o666))
        put_in_place(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def put_in_place(beside: Path, path: Path) -> None:
    """Rename the finished file `beside`, of the same folder, to `path`; this survives a loss of power."""
    _sync(beside)
    beside.replace(path)
    sync_folder(path.parent)


@contextmanager
def atomic_folder(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out`; when the block ends, it is fsynced and renamed to `out`.

    Raises:
        InputError: `out` exists and is not an empty folder, or cannot be made.
    """
    refuse_occupied(out)
    beside = _folder_beside(out)
    try:
        beside.chmod(_mode(0o777))
        yield beside
        for folder, _, files in os.walk(beside):
            for name in files:
                _sync(Path(folder, name))
            sync_folder(Path(folder))
        refuse_occupied(out)
        beside.rename(out)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise
    sync_folder(out.parent)


def check_place(out: Path) -> None:
    """Check before long work that a folder can be made at `out`.

    Raises:
        InputError: `out` exists and is not an empty folder, or cannot be made.
    """
    refuse_occupied(out)
    _folder_beside(out).rmdir()


def refuse_occupied(out: Path) -> None:
    """Check that `out` is free.

    Raises:
        InputError: `out` exists and is not an empty folder.
    """
    if out.is_dir() and not any(out.iterdir()):
        return
    if out.exists() or out.is_symlink():
        raise InputError(f"{out} exists already; choose another --out, or remove it first")


def json_bytes(value: Any) -> bytes:
    """`value` as indented JSON; equal values give equal bytes.

    Raises:
        ValueError: a number that is not finite.
    """
    return (json.dumps(value, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False) + "\n").encode()


def _folder_beside(out: Path) -> Path:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=f".{out.name}.partial-", dir=out.parent))
    except OSError as error:
        raise InputError(f"{out} cannot be made: {error.strerror}; choose another place with --out") from None


def _mode(wanted: int) -> int:
    """`wanted` without the bits of the process's mask, which temporary files do not honour by themselves."""
    mask = os.umask(0)
    os.umask(mask)
    return wanted & ~mask


def _sync(path: Path) -> None:
    with path.open("rb") as file:
        os.fsync(file.fileno())


def sync_folder(path: Path) -> None:
    """Make the names of a folder's files durable."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
