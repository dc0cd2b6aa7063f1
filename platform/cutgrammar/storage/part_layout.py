"""Parquet files of strangers: how they are laid out, checked before anything in them is unpacked.

A few bytes can stand for gigabytes, compressed or as a value that repeats. What a file says of its sizes is checked
here; `untrusted.memory` bounds what it takes where it lies.
"""

from typing import Any

MAX_ROWS = 1_000_000
"""Most rows of one trial in one table."""
MAX_UNPACKED = 256_000_000
"""Most bytes of one trial in one table, unpacked."""
MAX_GROUPS = 100_000
ENCODINGS = {"PLAIN", "RLE", "BIT_PACKED"}
"""How this package writes; others can repeat a value without end."""
CODECS = {"ZSTD", "UNCOMPRESSED", "SNAPPY"}


def check_layout(metadata: Any) -> None:
    """Check the footer of a part.

    Args:
        metadata: pyarrow's `FileMetaData`.

    Raises:
        ValueError: it says that it has more than a part can have, or is encoded otherwise.
    """
    if metadata.num_row_groups > MAX_GROUPS:
        raise ValueError(f"it has {metadata.num_row_groups} row groups; at most {MAX_GROUPS} are read")
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        if not 0 <= group.num_rows <= MAX_ROWS or not 0 <= group.total_byte_size <= MAX_UNPACKED:
            raise ValueError(
                f"row group {number} has {group.num_rows} rows and {group.total_byte_size} bytes; one trial is expected"
            )
        for place in range(group.num_columns):
            column = group.column(place)
            if not set(column.encodings) <= ENCODINGS or column.compression not in CODECS:
                raise ValueError(f"row group {number} is encoded or compressed in another way than parts are")
            if not 0 <= column.total_uncompressed_size <= MAX_UNPACKED or not 0 <= column.num_values <= MAX_UNPACKED:
                raise ValueError(f"a column of row group {number} says that it has {column.num_values} values")
