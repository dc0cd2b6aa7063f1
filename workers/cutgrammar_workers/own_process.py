"""A child process that carries out tasks one at a time, so that its death can be explained and costs one task.

How a process ended is known to its parent alone. A crash (a fault of memory, an abort, an exit) is the task's own
doing. A signal that no crash raises, as the SIGKILL of an administrator or of the kernel when memory is full, is a
fault of the machine, unless the process sent it to itself, which its audit hook reports.
"""

import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection
from io import BytesIO
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import IO, Any

from cutgrammar.errors import InputError
from cutgrammar_workers.tasks import MAX_TEXT, START_SECONDS, Crashed, WorkerFactory, printable, too_slow
from cutgrammar_workers.time_limit import OutOfTime

CRASHES = frozenset(
    getattr(signal, name)
    for name in ("SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT", "SIGSYS", "SIGTRAP", "SIGPIPE", "SIGALRM")
    if hasattr(signal, name)
)
"""Signals that a process raises by what it does; others are sent from outside."""
POLL_SECONDS = 0.2
"""How long the death of a process can go unnoticed, where a child of its own holds its pipe open [s]."""
CLOSE_SECONDS = 2.0
"""How long a process may take to end when it is asked to [s]."""
OUTLET = "outlet"
"""Stands for `shared.outlet` in the child, whose calls are made in the parent."""


class OwnProcess:
    """Calls a worker in a child process, which is started when it is needed and again after its death.

    Args:
        make_worker: makes the worker; a class of an importable module.
        shared: what it is made from. If it has a method `alone`, the child gets what that returns; if it has an
            `outlet`, calls of that are made in this process.
        max_start_seconds: time limit for building the worker [s]; a child that exceeds it is a fault of the machine.
    """

    def __init__(self, make_worker: WorkerFactory, shared: Any, max_start_seconds: float = START_SECONDS) -> None:
        self._max_start_seconds = max_start_seconds
        self._outlet = getattr(shared, "outlet", None)
        content = BytesIO()
        pickler = _Pickler(content)
        pickler.outlet = self._outlet
        pickler.dump((make_worker, shared.alone() if hasattr(shared, "alone") else shared))
        self._content = content.getvalue()
        self._child: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None
        self._trace: IO[bytes] | None = None
        self._own_signals: set[int] = set()

    def __call__(self, task: Any, seconds: float | None = None) -> Any:
        """The worker's result for `task`, or the `Crashed` that says how the process died or that it hung at its start.

        Args:
            task: see `WorkerFactory`.
            seconds: time limit; None for none.

        Raises:
            OutOfTime: the limit was exceeded; the process has been killed.
            InputError: the user's input is wrong.
        """
        kills = _oom_kills()
        try:
            try:
                pipe = self._started()
            except OutOfTime:
                return self._hang()
            deadline = None if seconds is None else time.monotonic() + seconds
            pipe.send(task)
            while True:
                kind, value = self._next(pipe, deadline)
                if kind == "result":
                    return value
                if kind == "input error":
                    raise InputError(value)
                if kind == "news" and self._outlet is not None:
                    self._outlet(value)
                if kind == "signal":
                    self._own_signals.add(value)
        except (EOFError, ConnectionError):
            return self._death(kills)
        except BaseException:
            self.close(at_once=True)
            raise

    def close(self, at_once: bool = False) -> None:
        """End the process; at once, or when it has noticed that nothing more will come."""
        if self._pipe is not None:
            self._pipe.close()
        if self._child is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._child.wait(0.0 if at_once else CLOSE_SECONDS)
            self._child.kill()
            self._child.wait()
        if self._trace is not None:
            self._trace.close()
        self._child = self._pipe = self._trace = None
        self._own_signals = set()

    def _started(self) -> Connection:
        if self._pipe is None:
            self._pipe, other = Pipe()
            environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
            self._trace = tempfile.TemporaryFile()  # noqa: SIM115  (held until the process is closed)
            files = [other.fileno(), self._trace.fileno()]
            words = [
                sys.executable,
                "-P",
                "-m",
                "cutgrammar_workers.own_process_main",
                *map(str, [*files, os.getpid()]),
            ]
            self._child = subprocess.Popen(words, pass_fds=files, env=environment)
            other.close()
            self._pipe.send_bytes(self._content)
            self._next(self._pipe, time.monotonic() + self._max_start_seconds)  # that it is ready
        return self._pipe

    def _next(self, pipe: Connection, deadline: float | None) -> tuple[str, Any]:
        """The next message of the child.

        Raises:
            EOFError, ConnectionError: it has died.
            OutOfTime: `deadline` has passed.
        """
        assert self._child is not None
        while not pipe.poll(POLL_SECONDS):
            if self._child.poll() is not None and not pipe.poll(0.0):
                raise EOFError
            if deadline is not None and time.monotonic() > deadline:
                raise OutOfTime
        kind, value = pipe.recv()
        return kind, value

    def _death(self, kills: int | None) -> Crashed:
        """How the process ended."""
        assert self._child is not None
        assert self._trace is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(CLOSE_SECONDS)  # its pipe closes a moment before it ends
        code, pid, host = self._child.poll(), self._child.pid, socket.gethostname()
        how, by_machine = _meaning(code, self._own_signals)
        if by_machine and kills is not None and (_oom_kills() or 0) > kills:
            how += ", for the memory was full"
        return Crashed(f"process {pid} on {host} {how}", self._ended(), by_machine, died=True, host=host, pid=pid)

    def _hang(self) -> Crashed:
        """That the process was not ready in time, and where it was."""
        assert self._child is not None
        pid, host = self._child.pid, socket.gethostname()
        self._child.send_signal(signal.SIGABRT)  # makes it write its trace
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(CLOSE_SECONDS)
        reason = f"{too_slow(self._max_start_seconds)} in process {pid} on {host}"
        return Crashed(reason, self._ended(), by_machine=True, died=True, host=host, pid=pid)

    def _ended(self) -> str:
        """End the process; its trace."""
        assert self._trace is not None
        self._trace.seek(0)
        trace = printable(self._trace.read(MAX_TEXT).decode("utf-8", "replace"))
        self.close(at_once=True)
        return trace


def _meaning(code: int | None, own_signals: Collection[int]) -> tuple[str, bool]:
    """What an exit code says, and whether the machine was at fault."""
    if code is None:
        return "closed its connection", False
    if code >= 0:
        return f"exited with code {code}", False
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    is_own = -code in CRASHES or -code in own_signals
    return f"was ended by {name}" + ("" if is_own else " from outside"), not is_own


class _Pickler(pickle.Pickler):
    """Writes what the parent shares; `OUTLET` stands for its outlet."""

    outlet: Any = None

    def persistent_id(self, thing: object) -> str | None:
        return OUTLET if thing is self.outlet and thing is not None else None


def _oom_kills() -> int | None:
    """How often the kernel has killed a process of this control group because its memory was full; None if unknown."""
    try:
        group = next(line[3:] for line in Path("/proc/self/cgroup").read_text().splitlines() if line.startswith("0::"))
        lines = Path(f"/sys/fs/cgroup{group}/memory.events").read_text().splitlines()
        return int(next(line.split()[1] for line in lines if line.startswith("oom_kill ")))
    except (OSError, StopIteration, ValueError, IndexError):
        return None
