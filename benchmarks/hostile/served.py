"""A command that serves a page, as a process of its own, and people who work on it beside hostile clients."""

import contextlib
import http.client
import json
import re
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hostile.clients import MESSAGES
from hostile.running import CONTROL

STOP = 300.0
"""When a command that was told to end is killed [s]; `rate` first logs to MLflow, which takes a busy machine long."""
MOST_LINES = 20
"""Lines that hostile clients may make a command print."""


class Served:
    """`cutgrammar WORDS --port 0` in a folder; what it prints is kept in a file.

    Attributes:
        port: of the page.
    """

    def __init__(self, words: Sequence[str], folder: Path, files: int | None = None) -> None:
        """Start the command, and wait until it serves.

        Args:
            words: of the command.
            folder: where it is started.
            files: maximum number of files that it may have open.
        """
        self._words, self._folder, self._files = [*words, "--port", "0"], folder, files
        self._printed = folder / "printed.txt"
        self.port = 0
        self.start()

    def start(self) -> None:
        """Start the command again."""
        limit = self._files

        def limited() -> None:
            if limit is not None:
                resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))

        command = [sys.executable, "-m", "cutgrammar_pipelines", *self._words]
        with self._printed.open("wb") as printed:
            self._process = subprocess.Popen(
                command, cwd=self._folder, stdout=printed, stderr=subprocess.STDOUT, preexec_fn=limited
            )
        while not (found := re.search(r"the page is at http://[^:]*:(\d+)/", self.printed)):
            with contextlib.suppress(subprocess.TimeoutExpired):
                raise RuntimeError(f"ended with {self._process.wait(0.2)}: {self.printed}")
        self.port = int(found[1])

    @property
    def printed(self) -> str:
        """All that it has printed."""
        return self._printed.read_text(errors="replace")

    def problem(self) -> str | None:
        """What is wrong with the process or with what it printed, or None."""
        if (code := self._process.poll()) is not None:
            return f"ended with {code}: {self.printed[-500:]}"
        text = self.printed
        if "Traceback" in text or "Exception" in text:
            return f"traceback: {text[-1500:]}"
        if found := CONTROL.search(text):
            return f"prints the control character {found.group()!r}"
        if (lines := text.count("\n")) > MOST_LINES:
            return f"prints {lines} lines: {text[-300:]}"
        return None

    def stop(self) -> int:
        """End it as Ctrl-C does; its exit code."""
        self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(STOP)
        finally:
            self._process.kill()


class Person(threading.Thread):
    """Somebody who works on a page as invited until told to stop.

    Attributes:
        kept: what the server said that it keeps: trials that are saved, or answers.
        problems: answers that a person should not get.
    """

    def __init__(self, page: str, port: int, code: str) -> None:
        super().__init__(daemon=True)
        self._work = {"record": self._demonstrate, "rate": self._rate}[page]
        self._port, self._code, self._stopped, self._key = port, code, threading.Event(), ""
        self.kept: set[int] = set()
        self.problems: list[str] = []

    def run(self) -> None:
        """Work until `leave` is called or nothing is left to do."""
        while not self._stopped.is_set():
            try:
                if not self._work():
                    return
            except (OSError, http.client.HTTPException) as error:
                self.problems.append(f"{type(error).__name__}: {error}")
            self._stopped.wait(0.02)

    def leave(self) -> None:
        """Stop after what is being done."""
        self._stopped.set()
        self.join(120)

    def _demonstrate(self) -> bool:
        """One demonstration: a cut, undone and made again, and saved."""
        joined = self._post("/api/join", {"code": self._code, "robot": True})
        if joined["task"] is None:
            return False
        self._key, after = joined["key"], joined["after"]
        stroke = dict(MESSAGES)["/api/cut"]
        if not joined["cuts"]:
            after = self._post("/api/cut", stroke | {"after": after})["after"]
            after = self._post("/api/undo", {"after": after, "seconds": 4.0, "robot": True})["after"]
            after = self._post("/api/cut", stroke | {"after": after})["after"]
        self.kept.add(self._post("/api/save", {"after": after, "seconds": 9.0, "robot": True})["saved"])
        return True

    def _rate(self) -> bool:
        """One answer."""
        joined = self._post("/api/join", {"code": self._code, "robot": True})
        if "pair" not in joined:
            return False
        self._key = joined["key"]
        answer = {"after": joined["after"], "pair": joined["pair"], "rating": 3, "seconds": 2.0, "robot": True}
        self.kept.add(self._post("/api/rate", answer)["answered"])
        return True

    def _post(self, path: str, message: dict[str, Any]) -> dict[str, Any]:
        headers = {
            "Content-Type": "application/json",
            "Origin": f"http://127.0.0.1:{self._port}",
            "X-Session": self._key,
        }
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", self._port, timeout=60)) as connected:
            connected.request("POST", path, json.dumps(message), headers)
            answer = connected.getresponse()
            content = answer.read()
        if answer.status != 200:
            raise http.client.HTTPException(f"{path}: {answer.status} {content[:300]!r}")
        return dict(json.loads(content))
