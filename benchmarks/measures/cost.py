"""Time and memory of work that is done in a process of its own."""

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any


def cost_of(work: Callable[[], Any]) -> dict[str, Any]:
    """Do it in this process: its processor time `cpu` [s], time `seconds` and largest memory `mb`, and what it returns.

    The memory is that of the whole process so far, without its children.
    """
    begin = time.perf_counter()
    found = work()
    used = resource.getrusage(resource.RUSAGE_SELF)
    # The largest memory that getrusage knows may be that of the process which started this one.
    largest = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return {
        "cpu": used.ru_utime + used.ru_stime,
        "seconds": time.perf_counter() - begin,
        "mb": int(largest.split()[1]) / 1024,
        "found": found,
    }


def cost_in_own_process(words: Sequence[str]) -> dict[str, Any]:
    """What a Python script prints as its last line: a cost as JSON. Exits where there is none."""
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        sys.exit(f"{' '.join(words)}\n{done.stdout}\n{done.stderr}")
    facts: dict[str, Any] = json.loads(lines[-1])
    return facts
