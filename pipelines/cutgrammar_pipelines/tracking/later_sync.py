"""Logs runs to MLflow beside a server, in processes of their own, so that nobody who uses the page waits for it."""

import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue


class LaterSync:
    """Logs runs again whenever it is asked to, one process at a time; several requests that wait are one."""

    def __init__(self, runs: Sequence[Path]) -> None:
        self._runs = tuple(dict.fromkeys(runs))
        self._requests: SimpleQueue[bool] = SimpleQueue()  # False is the end
        self._thread = threading.Thread(target=self._work, name="sync with MLflow")

    def __enter__(self) -> "LaterSync":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Carry out what is requested, and end."""
        self._requests.put(False)
        self._thread.join()

    def request(self) -> None:
        """Ask for the runs to be logged soon."""
        self._requests.put(True)

    def _work(self) -> None:
        is_over = False
        while not is_over:
            requests = [self._requests.get()]
            while not self._requests.empty():
                requests.append(self._requests.get())
            is_over = not all(requests)
            for run in self._runs if any(requests) else ():
                command = [sys.executable, "-m", "cutgrammar_pipelines", "sync", str(run)]
                # In a session of its own, Ctrl+C in the terminal ends the server and not what it is logging.
                subprocess.run(command, stdout=subprocess.DEVNULL, start_new_session=True, check=False)
