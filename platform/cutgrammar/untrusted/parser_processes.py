"""Parsers in processes of their own: a crafted file that kills one, or never lets it end, ends no command.

A library written in C, C++ or Rust can abort at a crafted file, which no `except` catches. A module that reads files
with such a library is run here as a process, whose death is an answer like any other.
"""

import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

REFUSED = 3
"""Exit code of a process that refuses what it was given; the last line of stderr is the reason."""
MAX_MEMORY = 4 * 2**30
"""Address space of a process [bytes]."""
MAX_SECONDS = 90
"""Processor time of a process [s]."""
TIMEOUT = 180.0
"""When a process is stopped [s]; the machine may be busy."""


@dataclass(frozen=True)
class Answer:
    """What a parser process left behind.

    Attributes:
        code: exit code; None if it was stopped since it took too long, negative if it died of a signal.
        output: what it wrote to stdout.
        message: the last line that it wrote to stderr; "" if there is none.
    """

    code: int | None
    output: bytes
    message: str

    @property
    def has_died(self) -> bool:
        """Whether a signal or the limit of memory ended the process."""
        return self.code is not None and (self.code < 0 or self.message.startswith("MemoryError"))

    @property
    def reason(self) -> str:
        """Why there is no output, for a message."""
        if self.code is None:
            return "it takes too long"
        return (
            "it ends the process that reads it, or never lets it end" if self.has_died else self.message or "no reason"
        )


def run_parser(module: str, arguments: Sequence[str], data: bytes, seconds: float = TIMEOUT) -> Answer:
    """Run a module as a process with `data` on stdin, and wait for it, at most so long."""
    command = [sys.executable, "-P", "-m", module, *arguments]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    try:
        child = subprocess.run(command, input=data, capture_output=True, timeout=seconds, env=environment, check=False)
    except subprocess.TimeoutExpired as late:
        return Answer(None, late.stdout or b"", "")
    messages = child.stderr.decode("utf-8", "replace").strip().splitlines()
    return Answer(child.returncode, child.stdout, messages[-1] if messages else "")


def limit_this_process(memory: int | None = MAX_MEMORY) -> None:
    """Bound the address space and the processor time of this process, a parser, and have it leave no core file."""
    if memory is not None:
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_SECONDS, MAX_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
