"""Runs a command on a stranger's files in a process of its own, and says what it did wrong."""

import io
import json
import os
import re
import resource
import select
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Iterable, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path

from cutgrammar.untrusted.parser_processes import time_of_parsers
from cutgrammar_pipelines.cli.main import main

SECONDS = 10.0
"""Time that a command may compute on a bad file [s]."""
WAIT = 60.0
"""When it is stopped [s], later than that since the machine may be busy."""
MEMORY = 2_000_000
"""Memory that it may take beyond what the parent has [kB]."""
LIMIT = 5 * 2**29
"""Where it is stopped [bytes], so that a command without bounds does no harm to the machine."""
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""What may not reach a terminal: control characters but tabs and line ends, and those that reverse text."""
LONGEST_LINE = 2_000


@dataclass(frozen=True)
class Result:
    """What a command did.

    Attributes:
        code: exit code; None if it was killed, negative if it died of a signal.
        out, err: what it printed.
        seconds: time that it, and the parsers that it ran, computed.
        memory: memory that it took beyond what the parent has [kB].
    """

    code: int | None
    out: str
    err: str
    seconds: float
    memory: int


def run(words: Sequence[str], folder: Path, seconds: float = WAIT) -> Result:
    """Run `cutgrammar WORDS` in `folder`, in a fork of this process."""
    reader, writer = os.pipe()
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os.setsid()
        _in_child(words, folder, writer)
    os.close(writer)
    content, is_late = _read_until_closed(reader, began + seconds)
    if is_late:
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    os.close(reader)
    took = usage.ru_utime + usage.ru_stime
    if is_late:
        return Result(None, "", "", took, 0)
    if not content:
        return Result(os.waitstatus_to_exitcode(status), "", "", took, 0)
    told = json.loads(content)
    return Result(told["code"], told["out"], told["err"], took + told["parsers"], told["memory"])


def warm_up(good: Path, place: Path, commands: Iterable[str]) -> None:
    """Run commands on good files in this process, so that those on hostile ones find all modules imported.

    Raises:
        RuntimeError: a command refuses good files.
    """
    for number, command in enumerate(commands):
        folder = place / str(number) / "stranger"
        shutil.copytree(good, folder)
        (folder.parent / "out").mkdir()
        out, err = io.StringIO(), io.StringIO()
        with chdir(folder), redirect_stdout(out), redirect_stderr(err):
            code = main(command.split())
        if code:
            raise RuntimeError(f"exit code {code} for good files: cutgrammar {command}: {err.getvalue()}")
        shutil.rmtree(folder.parent)


def problem_of(result: Result, named: Sequence[str], may_pass: bool) -> str | None:
    """What a command did wrong, or None.

    Args:
        result: what it did.
        named: words that its message must contain, such as the names of the file and the field; "a|b" is either.
        may_pass: whether it may accept the file.
    """
    printed = result.out + result.err
    if result.code is None:
        return f"hangs: not done after {WAIT:.0f} s"
    if result.seconds > SECONDS:
        return f"computes for {result.seconds:.0f} s"
    if result.code < 0:
        return f"dies of signal {-result.code}"
    if "Traceback" in printed or result.code == 70:
        return f"traceback: {(result.err.strip().splitlines() or ['?'])[-1][:200]}"
    if found := CONTROL.search(printed):
        return f"prints the control character {found.group()!r}"
    if result.memory > MEMORY:
        return f"takes {result.memory // 1000} MB"
    longest = max(map(len, printed.splitlines()), default=0)
    if result.code != 0 and longest > LONGEST_LINE:
        return f"prints a line of {longest} characters"
    if result.code == 0:
        return None if may_pass else "accepted"
    if result.code == 1 and may_pass:
        return None
    if result.code != 2:
        return f"exit code {result.code}: {result.err.strip()[-200:]}"
    lines = [line for line in result.err.splitlines() if line.startswith("cutgrammar ")]
    if len(lines) != 1:
        return f"{len(lines)} lines of error: {result.err.strip()[-300:]}"
    if missing := [word for word in named if not any(one in lines[0] for one in word.split("|"))]:
        return f"does not name {', '.join(missing)}: {lines[0][:300]}"
    return None


def _in_child(words: Sequence[str], folder: Path, writer: int) -> None:
    """Run the command, write what it did to the descriptor `writer` as JSON, and end this process."""
    try:
        os.chdir(folder)
        sys.stdin = open(os.devnull)  # noqa: SIM115  (for the rest of this process)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        parsers = time_of_parsers()
        limit_memory()
        out, err = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            try:
                code = main(words)
            except SystemExit as error:
                code = error.code if isinstance(error.code, int) else 1
            except BaseException:  # noqa: BLE001  (whatever it is, it is told)
                code = 70
                err.write(traceback.format_exc())
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        parsers = time_of_parsers() - parsers
        told = {"code": code, "out": out.getvalue(), "err": err.getvalue(), "memory": memory, "parsers": parsers}
        with os.fdopen(writer, "wb") as file:
            file.write(json.dumps(told).encode())
    finally:
        os._exit(0)


def limit_memory() -> None:
    """Let this process take at most `LIMIT` bytes of data memory beyond what it has mapped."""
    mapped = int(Path("/proc/self/statm").read_text().split()[5]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_DATA, (mapped + LIMIT, mapped + LIMIT))


def _read_until_closed(reader: int, until: float) -> tuple[bytes, bool]:
    """What is written to a descriptor, and whether it was still open at the time `until`."""
    parts = []
    while (left := until - time.monotonic()) > 0:
        if select.select([reader], [], [], left)[0]:
            part = os.read(reader, 1 << 16)
            if not part:
                return b"".join(parts), False
            parts.append(part)
    return b"", True


def foreign_writes(place: Path, allowed: Sequence[str]) -> list[str]:
    """The names in `place` that a command may not have made."""
    return sorted(entry.name for entry in place.iterdir() if entry.name not in allowed)
