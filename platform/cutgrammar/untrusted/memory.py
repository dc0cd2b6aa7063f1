"""A bound on the memory that a library may take to decompress what a stranger packed."""

import os
import resource
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

HEADROOM = 3 * 2**29
"""What may be taken beyond what the process has [bytes]."""
_lock = threading.Lock()
_within = 0
_before = (0, 0)
"""Bound that the process had before the first of the blocks that are open."""


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
    _enter(headroom)
    try:
        yield
    except MemoryError:
        raise ValueError(f"it needs more than {headroom // 2**20} MB of memory to be read") from None
    finally:
        _leave()


def _enter(headroom: int) -> None:
    """Bound the memory; a block inside another, or in another thread, moves the bound to its own need."""
    global _within, _before
    with _lock:
        soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if not _within:
            _before = (soft, hard)
        wanted = _data_memory() + headroom
        limit = wanted if _before[0] == resource.RLIM_INFINITY else min(wanted, _before[0])
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
        _within += 1


def _leave() -> None:
    """Give the process its former bound back once no block is open."""
    global _within
    with _lock:
        _within -= 1
        if not _within:
            resource.setrlimit(resource.RLIMIT_DATA, _before)


def _data_memory() -> int:
    """Data memory of this process [bytes]."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
