"""A worker that squares numbers, for tests of the pool; some of its tasks misbehave."""

import ctypes
import errno
import os
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar_workers.pool import run_all


@dataclass(frozen=True)
class Task:
    number: int
    mischief: str = ""


class Squarer:
    """Squares numbers; some tasks misbehave. `shared` is a folder in which deaths are counted."""

    def __init__(self, shared):
        self.folder = Path(shared)
        if (self.folder / "unbuildable").exists():
            raise RuntimeError("cannot be built")

    def __call__(self, task):
        if task.mischief == "raise":
            raise ZeroDivisionError("seven")
        if task.mischief == "user error":
            raise InputError("the mesh is open")
        if task.mischief == "be slow":
            time.sleep(0.2)
        if task.mischief == "never end":
            time.sleep(600.0)
        if task.mischief == "disk full once" and not (self.folder / f"full-{task.number}").exists():
            (self.folder / f"full-{task.number}").touch()
            raise OSError(errno.ENOSPC, "no space")
        if task.mischief == "memory full":
            raise MemoryError("too large")
        if task.mischief == "stop once" and not (self.folder / f"stopped-{task.number}").exists():
            (self.folder / f"stopped-{task.number}").touch()
            os.kill(os.getpid(), signal.SIGSTOP)
        if task.mischief == "die once" and not (self.folder / f"died-{task.number}").exists():
            (self.folder / f"died-{task.number}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if task.mischief == "spin":
            ctypes.PyDLL(None).pause()  # keeps Python's lock
        if task.mischief == "exit":
            os._exit(3)
        if task.mischief == "segfault":
            ctypes.string_at(0)
        if task.mischief.startswith("killed"):
            kill_from_outside(self.folder, task, "KILL", int(task.mischief.split()[1]))
        if task.mischief == "terminated once and caught":
            try:
                kill_from_outside(self.folder, task, "TERM", 1)
            except SystemExit:
                return "caught"
        if task.mischief == "die always":
            with (self.folder / "deaths").open("a") as log:
                log.write(f"{task.number}\n")
            os.kill(os.getpid(), signal.SIGKILL)
        return task.number**2


def kill_from_outside(folder, task, name, n):
    """Another program sends a signal to this process, `n` times in all."""
    times = len(list(folder.glob(f"killed-{task.number}-*")))
    if times < n:
        (folder / f"killed-{task.number}-{times}").touch()
        subprocess.run(["/bin/kill", f"-{name}", str(os.getpid())], check=True)
        time.sleep(60.0)


def results_of(tasks, folder, workers, **more):
    results = []
    run_all(Squarer, str(folder), tasks, lambda index, result: results.append((index, result)), workers, **more)
    assert len({index for index, _ in results}) == len(results), "a result came twice"
    return dict(results)
