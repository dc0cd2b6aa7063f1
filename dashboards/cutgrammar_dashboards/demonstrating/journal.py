"""The journal of an open demonstration: one line of JSON for each action, appended and synced before it is answered.

Each line begins with its checksum. A process or machine that dies leaves at most one incomplete line at the end, which
was never answered: readers ignore it, and the next writer removes it. When an append fails, as on a full disk, the
file is cut back to its last complete line.
"""

import json
import os
import zlib
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import sync_folder
from cutgrammar.errors import InputError
from cutgrammar.untrusted import parse_json, read_regular

MAX_BYTES = 100_000_000


def read_journal(path: Path) -> list[dict[str, Any]]:
    """The complete lines of a journal; none if there is no such file.

    Raises:
        InputError: it is no ordinary file, or a line with the right checksum is no JSON.
    """
    return _complete(path)[0]


class Journal:
    """Appends to a journal, which is created when needed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = _complete(path)[1]

    def append(self, entry: dict[str, Any]) -> None:
        """Append an entry; when this returns, it is on disk.

        Raises:
            OSError: it could not be written, e.g. because the disk is full; the journal is as before.
        """
        text = json.dumps(entry, sort_keys=True, allow_nan=False).encode()
        line = b"%08x %s\n" % (zlib.crc32(text), text)
        is_new = not self._path.exists()
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            os.ftruncate(descriptor, self._size)
            try:
                written = os.pwrite(descriptor, line, self._size)
                if written != len(line):
                    raise OSError(28, os.strerror(28))
                os.fsync(descriptor)
            except OSError:
                os.ftruncate(descriptor, self._size)
                raise
        finally:
            os.close(descriptor)
        if is_new:
            sync_folder(self._path.parent)
        self._size += len(line)


def _complete(path: Path) -> tuple[list[dict[str, Any]], int]:
    """The entries up to the first incomplete line, and their length in bytes."""
    entries: list[dict[str, Any]] = []
    size = 0
    content = read_regular(path, MAX_BYTES) if path.exists() else b""
    for line in content.splitlines(keepends=True):
        checksum, _, text = line.rstrip(b"\n").partition(b" ")
        if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
            break
        try:
            entries.append(parse_json(text))
        except ValueError as error:
            raise InputError(f"{path}, line {len(entries) + 1}: {error}; move the file away") from None
        size += len(line)
    return entries, size
