"""The process that reads the footers of untrusted parts first; `part_footers` runs it.

Stdin has the paths of the files, with a zero byte between them. For each of them one byte is written to stdout: the
process survived it. Whether a footer is right is not its concern.
"""

import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from cutgrammar.storage.part_layout import check_layout
from cutgrammar.untrusted.memory import bounded_memory
from cutgrammar.untrusted.parser_processes import limit_this_process


def main() -> None:
    """Read the footers as `part_footers` does."""
    limit_this_process(memory=None)
    paths = sys.stdin.buffer.read().decode("utf-8", "surrogateescape").split("\0")
    for path in paths:
        survive(Path(path))
        sys.stdout.buffer.write(b".")
        sys.stdout.buffer.flush()


def survive(path: Path) -> None:
    """Do with a part's footer all that is done with it later."""
    try:
        with bounded_memory(), pq.ParquetFile(path) as file:
            check_layout(file.metadata)
            repr(file.schema_arrow)
    except (OSError, ValueError, MemoryError, pa.ArrowException):
        pass  # it is refused where it is read again


if __name__ == "__main__":
    main()
