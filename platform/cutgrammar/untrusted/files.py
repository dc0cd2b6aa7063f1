"""The one place that opens a stranger's file: ordinary files only, and no more bytes than a limit.

A named pipe would wait for a writer for ever, and a device or a sparse file would fill the memory.
"""

import os
import stat
from pathlib import Path
from typing import IO

from cutgrammar.errors import InputError

KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def read_regular(path: Path, limit: int) -> bytes:
    """The content of an ordinary file.

    Args:
        path: the file, or a link to it.
        limit: most bytes that it may have.

    Raises:
        InputError: it is a folder, pipe, socket or device, or has more bytes.
        OSError: it does not exist, or cannot be read.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check(path, os.fstat(descriptor), limit)
    except InputError:
        os.close(descriptor)
        raise
    with os.fdopen(descriptor, "rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:  # it grew meanwhile
        raise InputError(_too_large(path, limit))
    return content


def check_regular(path: Path, limit: int | None = None) -> None:
    """Check that `path` is an ordinary file, before a library opens it by its name.

    Args:
        path: the file, or a link to it.
        limit: most bytes that it may have; None for any number.

    Raises:
        InputError: it is a folder, pipe, socket or device, or has more bytes.
        OSError: it does not exist.
    """
    _check(path, path.stat(), limit)


def open_lock(path: Path) -> IO[bytes]:
    """A lock file, which is created where it does not exist, to be held until it is closed.

    Raises:
        InputError: it is a link, or no ordinary file.
        OSError: it cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(f"{path} is a link or no ordinary file; remove it") from None
        raise error
    try:
        _check(path, os.fstat(descriptor), None)
    except InputError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "r+b")


def check_inside(path: Path, folder: Path) -> None:
    """Check that what is written at `path` stays in `folder`, wherever links lead.

    Raises:
        InputError: it would not.
    """
    inside, target = folder.resolve(), path.parent.resolve() / path.name
    if path.name == ".." or not target.is_relative_to(inside) or target == inside:
        raise InputError(f"{path} is outside {folder}, so it is not written; remove the link or name that leads there")


def _check(path: Path, facts: os.stat_result, limit: int | None) -> None:
    if not stat.S_ISREG(facts.st_mode):
        kind = next((name for test, name in KINDS if test(facts.st_mode)), "no file")
        raise InputError(f"{path} is {kind}; an ordinary file is expected")
    if limit is not None and facts.st_size > limit:
        raise InputError(_too_large(path, limit))


def _too_large(path: Path, limit: int) -> str:
    return f"{path} is too large: more than {limit // 1_000_000} MB, which no file of its kind needs"
