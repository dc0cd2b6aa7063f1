"""Hostile requests to the pages that participants open: the guard and the page's own messages behind it."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.manifest import Manifest
from cutgrammar.storage.ratings import RatingStore, ratings_of
from cutgrammar.trials.rating_plan import RESULT, Pair
from cutgrammar.trials.record import TrialKey
from cutgrammar_dashboards.demonstrating.app import demonstration_page
from cutgrammar_dashboards.demonstrating.collection import Collection
from cutgrammar_dashboards.demonstrating.task import Task
from cutgrammar_dashboards.pages.access import access_to
from cutgrammar_dashboards.pages.guard import Guard
from cutgrammar_dashboards.rating.app import rating_page
from cutgrammar_dashboards.rating.panel import Panel
from cutgrammar_dashboards.rating.shown_pair import ShownPairs
from hostile.running import CONTROL

HOST = "127.0.0.1:8765"
KEYS = tuple(TrialKey("N1M1", trial, "in-place", "random", 0, "bench", "truth", "0" * 64) for trial in range(3))
PAIRS = tuple(Pair(RESULT, key) for key in KEYS)

NAMES = ("host", "origin", "content-length", "content-type", "x-session", "cookie", "transfer-encoding")
VALUES = ("", "x" * 5000, "\x1b[2J", "-1", "9" * 50, "null", "é", "cutgrammar_token=\x00;;=", "*")
PATHS = (
    "/api/pair/-1",
    f"/api/pair/{'9' * 5000}",
    "/static/../../etc/passwd",
    "/examples/..%2f..%2fx.png",
    "/\x00",
    "//",
    "/api/state",
)


class Pages:
    """Both pages behind their guards, with one participant each, and good requests to them."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        box = trimesh.creation.box((0.2, 0.04, 0.04))
        start = (Fragment(Mesh(box.vertices, box.faces), Pose(np.eye(3), np.array([0.0, 0.0, 0.02]))),)

        def task(trial: int) -> Task:
            return Task(trial, "N1M1", ("slices",), ("block",), (("slices",),), start, 0)

        collection = Collection(folder, range(1000), task, Manifest({}, 0, "by hand", {}, (), ()))
        (folder / "run").mkdir()
        store = RatingStore(ratings_of(folder / "run"))
        panel = Panel({key.digest: store for key in KEYS}, {pair.digest: pair for pair in PAIRS}, lambda _: PAIRS)
        shown = ShownPairs(lambda _: TrialConfigurations(start, start, start))
        access = access_to("127.0.0.1", 8765)
        self._apps = {
            "demonstration page": Guard(demonstration_page(collection, {}), access),
            "rating page": Guard(rating_page(panel, shown), access),
        }
        self.state = {name: self._join(name) for name in self._apps}

    def _join(self, page: str) -> dict[str, Any]:
        _, content = self.ask(page, "POST", "/api/join", json.dumps({"code": "P1", "robot": False}).encode(), {})
        return dict(json.loads(content))

    def good(self, page: str, rng: Random) -> tuple[str, dict[str, Any]]:
        """The path and message of a request that the page would carry out."""
        now = self.state[page]
        if page == "rating page":
            answer = {"after": now["after"], "pair": now.get("pair", "0" * 24), "rating": 3, "seconds": 1.0}
            return rng.choice((("/api/join", {"code": "P1"}), ("/api/rate", answer), ("/api/rate", answer)))
        x = rng.uniform(-0.08, 0.08)
        action = {"after": now.get("after", 0), "seconds": 5.0}
        ends = {"eye": [x, -1.0, 0.5], "first": [0.0, 1.05, -0.44], "second": [0.0, 0.95, -0.52], "explode": 0.0}
        stroke = action | ends | {"first_seconds": 1.0, "second_seconds": 2.0}
        return rng.choice(
            (
                ("/api/join", {"code": "P1"}),
                ("/api/preview", stroke),
                ("/api/cut", stroke),
                ("/api/undo", action),
                ("/api/save", action),
            )
        )

    def request(self, page: str, rng: Random, change: Callable[[Random, Any], bytes]) -> str | bool:
        """Send a good request that was changed; what was wrong with the answer, or whether it was accepted."""
        path, message = self.good(page, rng)
        headers = {"x-session": str(self.state[page].get("key", ""))}
        body = change(rng, message | {"robot": False})
        kind = rng.random()
        if kind < 0.1:
            headers[rng.choice(NAMES)] = rng.choice(VALUES)
        elif kind < 0.2:
            path = rng.choice((f"{path}/../..", *PATHS))
        method = rng.choice(("POST",) * 12 + ("GET", "PUT", "OPTIONS", "\x00"))
        status, content = self.ask(page, method, path, body, headers)
        if status >= 500:
            return f"status {status}: {content[:200]!r}"
        if found := CONTROL.search(content.decode("utf-8", "replace")):
            return f"answers the control character {found.group()!r}"
        if status == 200 and path in ("/api/join", "/api/cut", "/api/undo", "/api/rate", "/api/save"):
            self.state[page] |= json.loads(content)
            if path == "/api/save":
                self.state[page] = self._join(page)
        return status == 200

    def ask(self, page: str, method: str, path: str, body: bytes, headers: dict[str, str]) -> tuple[int, bytes]:
        """Status and content of the answer to a request."""
        own = {"host": HOST, "origin": f"http://{HOST}", "content-type": "application/json"} | headers
        pairs = [(name.encode(), value.encode("latin-1", "replace")) for name, value in own.items()]
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": path,
            "raw_path": path.encode(),
            "query_string": b"",
            "root_path": "",
            "headers": pairs,
            "client": ("127.0.0.1", 50000),
            "server": ("127.0.0.1", 8765),
        }
        parts = [body[i : i + 1000] for i in range(0, len(body), 1000)] or [b""]
        answer: dict[str, Any] = {"status": 0, "content": b""}

        async def receive() -> dict[str, Any]:
            if not parts:
                return {"type": "http.disconnect"}
            return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

        async def send(message: Any) -> None:
            if message["type"] == "http.response.start":
                answer["status"] = message["status"]
            else:
                answer["content"] += message.get("body", b"")

        asyncio.run(self._apps[page](scope, receive, send))
        return answer["status"], answer["content"]
