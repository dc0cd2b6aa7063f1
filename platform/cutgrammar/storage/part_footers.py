"""The footers of parts, which a process of its own reads first: pyarrow can end the process at a crafted one.

One process reads those of all parts that are opened together. Parts that this process wrote, or that a process has
read before, need none.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import islice
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from cutgrammar.storage.part_layout import check_layout
from cutgrammar.untrusted.memory import bounded_memory
from cutgrammar.untrusted.parser_processes import Answer, run_parser

MAX_FILES = 2_000
"""Most files that one process reads."""
Version = tuple[int, int, int, int]
"""What tells a file from all others and from itself before a change."""
_harmless: set[Version] = set()


class DeadlyPartError(ValueError):
    """A part whose footer ends the process that reads it.

    Attributes:
        path: of the part.
    """

    def __init__(self, path: Path, answer: Answer) -> None:
        super().__init__(f"its footer cannot be read: {answer.reason}")
        self.path = path


def check_footers(paths: Sequence[Path]) -> None:
    """Read the footers of parts in a process of its own, which takes a fifth of a second however many they are.

    Other mistakes in them are found where they are read again.

    Raises:
        DeadlyPartError: one of them ends the process.
        OSError: one cannot be read.
    """
    unknown = iter([(path, version) for path in paths if (version := _version(path)) not in _harmless])
    while batch := list(islice(unknown, MAX_FILES)):
        names = "\0".join(str(path.absolute()) for path, _ in batch)
        answer = run_parser("cutgrammar.storage.footer_process", (), names.encode("utf-8", "surrogateescape"))
        read = len(answer.output)
        _harmless.update(version for _, version in batch[:read])
        if read < len(batch):
            raise DeadlyPartError(batch[read][0], answer)


def trust_footer(path: Path) -> None:
    """Take the footer of a part as one that can be read: this process wrote it, or another has read it."""
    _harmless.add(_version(path))


@contextmanager
def opened_part(path: Path, columns: pa.Schema, table: str) -> Iterator[pq.ParquetFile]:
    """A part of a table, of bounded size; its footer is read and checked once for all its trials.

    Args:
        path: of the part.
        columns: of the table.
        table: its name, for messages.

    Raises:
        OSError, ValueError: the file cannot be read, or has another table.
    """
    check_footers([path])
    with bounded_memory(), pa.OSFile(str(path)) as source:
        footer = _footer(path, columns, table, _version(path))
        with pq.ParquetFile(source, metadata=footer) as file:
            yield file


def _version(path: Path) -> Version:
    facts = path.stat()
    return facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns


@lru_cache(maxsize=100)
def _footer(path: Path, columns: pa.Schema, table: str, _version: Version) -> pq.FileMetaData:
    with pq.ParquetFile(path) as file:
        check_layout(file.metadata)
        if not file.schema_arrow.equals(columns):
            raise ValueError(f"its columns are not those of the table {table}")
        return file.metadata
