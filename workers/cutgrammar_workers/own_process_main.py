"""The main program of the child process of `OwnProcess`."""

import ctypes
import faulthandler
import os
import pickle
import signal
import sys
import threading
import time
from io import BytesIO
from multiprocessing.connection import Connection
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar_workers.own_process import OUTLET
from cutgrammar_workers.tasks import attempt, crash_of

PR_SET_PDEATHSIG = 1
"""Linux: the signal that a process gets when its parent dies."""
WATCH_SECONDS = 1.0
"""Time between two looks at the parent, where the system does not tell of its death [s]."""


def main() -> None:
    """Take the worker from the pipe, then task after task, until the parent closes the pipe."""
    pipe, trace, parent = Connection(int(sys.argv[1])), int(sys.argv[2]), int(sys.argv[3])
    _end_with(parent)
    faulthandler.enable(trace)
    signal.signal(signal.SIGINT, _leave_to_parent)
    _report_own_signals(pipe)
    news = Unpickler(BytesIO(pipe.recv_bytes()))
    news.pipe = pipe
    make_worker, shared = news.load()
    worker = make_worker(shared)
    pipe.send(("ready", None))
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        try:
            result = attempt(worker, task)
        except InputError as error:
            pipe.send(("input error", str(error)))
            continue
        _send(pipe, result)


class Unpickler(pickle.Unpickler):
    """Reads what the parent shares; its outlet becomes a function that sends news to the parent."""

    pipe: Connection

    def persistent_load(self, name: str) -> Any:
        """See `pickle.Unpickler`."""
        assert name == OUTLET
        return lambda news: self.pipe.send(("news", news))


def _send(pipe: Connection, result: Any) -> None:
    try:
        content = pickle.dumps(("result", result))
    except Exception as error:  # noqa: BLE001  # what cannot be sent ends this task, not the run
        content = pickle.dumps(("result", crash_of(error)))
    pipe.send_bytes(content)


def _report_own_signals(pipe: Connection) -> None:
    """Tell the parent of signals that this process sends to itself before it sends them."""

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event in ("os.kill", "os.killpg", "signal.pthread_kill"):
            target, number = arguments
            if event != "os.kill" or target in (os.getpid(), 0, -os.getpgrp(), -1):
                pipe.send(("signal", int(number)))

    sys.addaudithook(hook)


def _leave_to_parent(_number: int, _frame: object) -> None:
    """Ctrl-C reaches all processes of the terminal; the parent ends this one. Inherited by no other program."""


def _end_with(parent: int) -> None:
    """End this process when the parent dies, even if it is busy or stopped."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH_SECONDS)
    os._exit(1)


if __name__ == "__main__":
    main()
