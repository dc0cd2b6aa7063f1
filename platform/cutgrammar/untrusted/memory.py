"""A bound on the memory that a library may take to decompress what a stranger packed."""

import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager

HEADROOM = 3 * 2**29
"""What may be taken beyond what the process has [bytes]."""


@contextmanager
def bounded_memory(headroom: int = HEADROOM) -> Iterator[None]:
    """Within the block the process cannot take more than `headroom` bytes of data memory beyond what it has.

    What does not fit fails with `MemoryError` inside the library, which is raised here as `ValueError`. Other threads
    share the bound. Only Linux has such a bound; elsewhere nothing is limited.

    Raises:
        ValueError: more memory would have been needed.
    """
    if sys.platform != "linux":
        yield
        return
    before, hard = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = _data_memory() + headroom
    if before != resource.RLIM_INFINITY:
        wanted = min(wanted, before)
    try:
        resource.setrlimit(resource.RLIMIT_DATA, (wanted, hard))
        yield
    except MemoryError:
        raise ValueError(f"it needs more than {headroom // 2**20} MB of memory to be read") from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, hard))


def _data_memory() -> int:
    """Data memory of this process [bytes]."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
