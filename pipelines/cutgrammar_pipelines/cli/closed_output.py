"""Output whose reader has gone, as in `cutgrammar show data | head -1`: the program ends without a word."""

import os
import select
import sys
from typing import TextIO

CODE = 141
"""Exit code of a program that SIGPIPE ends, as a shell reports it."""


def silence_closed_output() -> bool:
    """Send standard output and errors to nowhere if their reader has gone; return whether one had.

    What is still buffered is lost, and Python can flush it at exit without complaint. A pipe or socket of other things
    that broke, such as a connection to a server, leaves both as they are.
    """
    closed = [stream for stream in (sys.stdout, sys.stderr) if stream is not None and _is_closed(stream)]
    for stream in closed:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
    return bool(closed)


def _is_closed(stream: TextIO) -> bool:
    """Whether nobody reads from the other end of the pipe that a stream writes to."""
    poll = select.poll()
    try:
        poll.register(stream.fileno(), 0)
    except (OSError, ValueError):  # no file at all, as in a notebook
        return False
    return any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0))
