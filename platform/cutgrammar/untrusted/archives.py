"""NumPy archives of strangers: arrays of numbers only, and no larger unpacked than they say and may be."""

import io
import zipfile
import zlib
from typing import Any

import numpy as np

from cutgrammar.untrusted.printing import shortened

MAX_ARRAYS = 32


def read_arrays(content: bytes, limit: int) -> dict[str, Any]:
    """The arrays in an .npz archive, by name.

    Args:
        content: of the archive.
        limit: most bytes of all arrays together, unpacked.

    Raises:
        ValueError: it is no such archive, larger, or an array holds anything but numbers.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            if len(members) > MAX_ARRAYS or sum(member.file_size for member in members) > limit:
                raise ValueError(f"the archive has more than {MAX_ARRAYS} arrays or {limit // 1_000_000} MB")
            return {
                member.filename.removesuffix(".npy"): _array(archive.read(member), member.filename)
                for member in members
            }
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"not an archive of arrays ({error})") from error


def _array(content: bytes, name: str) -> Any:
    """One array, whose header must agree with the number of bytes that are there."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"{shortened(name)} has another format than NumPy's first")
    shape, in_columns, kind = np.lib.format.read_array_header_1_0(stream)
    if kind.hasobject or kind.kind not in "fiu" or in_columns:
        raise ValueError(f"{shortened(name)} holds {kind}; numbers are expected")
    rest = content[stream.tell() :]
    size = kind.itemsize
    for length in shape:
        size *= length
    if size != len(rest) or min(shape, default=0) < 0:
        raise ValueError(f"{shortened(name)} says that it has the shape {shortened(shape)}, and does not")
    return np.frombuffer(rest, dtype=kind).reshape(shape)
