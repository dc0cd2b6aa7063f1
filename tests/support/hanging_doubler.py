"""A worker that doubles numbers, for tests of the pool; it hangs while it is built."""

import contextlib
import ctypes
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import ray


@dataclass(frozen=True)
class Shared:
    """What workers share.

    Attributes:
        folder: where they count how often they were built; "good" in it holds the id of a node on which none hangs.
        mischief: how they hang.
        times: how many of them.
        driver: process that is no child.
    """

    folder: Path
    mischief: str
    times: int = 10**6
    driver: int = 0


class Doubler:
    """Doubles numbers, once it is built."""

    def __init__(self, shared):
        self.folder = shared.folder
        if os.getpid() == shared.driver or is_good_node(shared.folder):
            return
        if not is_one_of_the_first(shared.folder, shared.times):
            return
        if shared.mischief == "sleep":
            time.sleep(600.0)
        if shared.mischief == "stop":
            os.kill(os.getpid(), signal.SIGSTOP)
        if shared.mischief == "spin":
            ctypes.PyDLL(None).pause()  # keeps Python's lock

    def __call__(self, task):
        while (self.folder / "good").exists() and not (self.folder / "set aside").exists():
            time.sleep(0.1)  # so that the good node does not do all the work before the other one is set aside
        return 2 * task


def is_one_of_the_first(folder, times):
    """Whether this process is among the first `times` ones; the file `built-…` of each of them holds its id."""
    for i in range(times):
        with contextlib.suppress(FileExistsError), (folder / f"built-{i}").open("x") as built:  # workers may race
            built.write(str(os.getpid()))
            return True
    return False


def is_good_node(folder):
    good = folder / "good"
    return good.exists() and good.read_text() == ray.get_runtime_context().get_node_id()
