"""Parsers in processes of their own: a crafted file that kills one, or never lets it end, ends no command.

A library written in C, C++ or Rust can abort at a crafted file, which no `except` catches. A module that reads files
with such a library is run here as a process, whose death is an answer like any other. The process has read no other
file, and its input and output are files in memory.

Starting Python and importing such a library takes longer than reading most files. The first call for a module therefore
starts a template (`parser_template`) that imports the module, and every call has the template fork a process that runs
the module's `main`. A process and its forks share one template a module, which lives until all of them have ended or
have asked for nothing for a minute; whichever of them finds it dead, or has another `sys.path` or environment, starts
its own. A module whose import starts threads must import what starts them in `main`: a fork does not have them. On
systems other than Linux there are no templates, and every call starts Python.
"""

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import BinaryIO

REFUSED = 3
"""Exit code of a process that refuses what it was given; the last line of stderr is the reason."""
MAX_MEMORY = 4 * 2**30
"""Address space of a process [bytes]."""
MAX_SECONDS = 90
"""Processor time of a process [s]."""
TIMEOUT = 180.0
"""When a process is stopped [s]; the machine may be busy."""
STOP_SECONDS = 10.0
"""How long a process that is stopped, or a template that takes a request, is waited for [s]."""
MAX_TOLD = 64
"""Most that a guard tells of a parser [bytes]."""
ATTEMPTS = 2
"""How often a file is read of which nobody tells how its process ended: whoever would tell was killed."""
HAS_TEMPLATES = hasattr(os, "memfd_create") and hasattr(os, "pidfd_open")
CHANGES_WITH_EVERY_TEST = "PYTEST_CURRENT_TEST"
"""Variable of the environment that needs no new template."""
_templates: dict[str, tuple[object, socket.socket]] = {}
"""Module -> what its template was started with, and the socket that ends it when it is closed."""
_lock = threading.Lock()
_spent = 0.0


@dataclass(frozen=True)
class Answer:
    """What a parser process left behind.

    Attributes:
        code: exit code; None if it was stopped since it took too long, negative if it died of a signal.
        output: what it wrote to stdout.
        message: the last line that it wrote to stderr; "" if there is none.
        seconds: processor time that it took [s].
    """

    code: int | None
    output: bytes
    message: str
    seconds: float = 0.0

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
    """Run the function `main` of a module as a process with `data` on stdin, and wait for it, at most so long.

    It runs as with `python -m`, without exit handlers; what it returns or raises is the exit code. Several threads may
    call this at once.

    Raises:
        OSError: the system starts no process.
    """
    global _spent
    deadline = time.monotonic() + seconds
    for _ in range(ATTEMPTS):
        try:
            if not HAS_TEMPLATES:
                return _answer_of_new_python(module, arguments, data, seconds)
            answer = _answer(module, arguments, data, deadline)
        except subprocess.TimeoutExpired as late:
            return Answer(None, late.stdout or b"", "")
        if answer is not None:
            with _lock:
                _spent += answer.seconds
            return answer
    return Answer(-signal.SIGKILL, b"", "")


def time_of_parsers() -> float:
    """Processor time of all parsers that this process has run [s]; they are no children that it has waited for."""
    return _spent


def _answer(module: str, arguments: Sequence[str], data: bytes, deadline: float) -> Answer | None:
    """What a parser process makes of the data; None if the template or the guard of the parser was killed."""
    with ExitStack() as stack:
        given, output, messages = [stack.enter_context(_memory_file(name)) for name in ("stdin", "stdout", "stderr")]
        given.write(data)
        given.seek(0)
        status, its_status = map(stack.enter_context, socket.socketpair())
        folder = os.open(".", os.O_PATH | os.O_DIRECTORY)
        stack.callback(os.close, folder)
        files = [given.fileno(), output.fileno(), messages.fileno(), folder, its_status.fileno()]
        refusal = _request(module, json.dumps(arguments).encode(), files, deadline)
        if refusal is not None:
            return refusal
        its_status.close()
        told, is_late = _told(status, deadline)
        if not told and not is_late:
            return None
        code, seconds = told.split() if told else (b"", b"0")
        output.seek(0)
        messages.seek(0)
        message = _last_line(messages.read())
        return Answer(None if is_late else int(code), output.read(), message, float(seconds))


def _answer_of_new_python(module: str, arguments: Sequence[str], data: bytes, seconds: float) -> Answer:
    command = [sys.executable, "-P", "-m", module, *arguments]
    child = subprocess.run(
        command, input=data, capture_output=True, timeout=seconds, env=_environment_of_parsers(), check=False
    )
    return Answer(child.returncode, child.stdout, _last_line(child.stderr))


def _environment_of_parsers() -> dict[str, str]:
    python_path = os.pathsep.join(filter(None, sys.path))
    return os.environ | {"PYTHONPATH": python_path, "OPENBLAS_NUM_THREADS": "1"}


def _memory_file(name: str) -> BinaryIO:
    return open(os.memfd_create(f"parser {name}"), "w+b")


def _told(status: socket.socket, deadline: float) -> tuple[bytes, bool]:
    """What the guard tells, b"" if it was killed, and whether the parser was late, and stopped."""
    try:
        status.settimeout(max(deadline - time.monotonic(), 1e-3))
        return status.recv(MAX_TOLD), False
    except TimeoutError:
        status.shutdown(socket.SHUT_WR)  # the guard kills the parser
        status.settimeout(STOP_SECONDS)
        with suppress(TimeoutError):
            return status.recv(MAX_TOLD), True
        return b"", True


def _request(module: str, request: bytes, files: Sequence[int], deadline: float) -> Answer | None:
    """Send a request to the module's template, which is started if there is none; an answer if it does not start."""
    environment = {name: value for name, value in os.environ.items() if name != CHANGES_WITH_EVERY_TEST}
    key = [sys.executable, *sys.path], environment
    with _lock:
        if module in _templates:
            known, line = _templates[module]
            if known == key:
                with suppress(OSError):  # it has been killed, or has ended since nobody used it
                    socket.send_fds(line, [request], files)
                    return None
            del _templates[module]
            line.close()  # it serves the requests that it has, and ends unless a fork of this process asks for more
        line, its_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with its_end, ExitStack() as failed:
            failed.callback(line.close)
            command = [sys.executable, "-P", "-m", "cutgrammar.untrusted.parser_template", module]
            started = subprocess.run(
                command,
                stdin=its_end.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=max(deadline - time.monotonic(), 1e-3),
                env=_environment_of_parsers(),
                start_new_session=True,  # it is not interrupted from the keyboard
                check=False,
            )
            if started.returncode:
                why = _last_line(started.stderr) or f"{sys.executable} ends with {started.returncode}"
                return Answer(1, b"", f"no process can be started that reads it: {why}")
            line.settimeout(STOP_SECONDS)
            socket.send_fds(line, [request], files)
            failed.pop_all()
        _templates[module] = key, line
    return None


def _last_line(messages: bytes) -> str:
    lines = messages.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""


os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


def limit_this_process(memory: int | None = MAX_MEMORY) -> None:
    """Bound the address space and the processor time of this process, a parser, and have it leave no core file."""
    if memory is not None:
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_SECONDS, MAX_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
