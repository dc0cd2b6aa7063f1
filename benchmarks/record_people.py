"""Twenty people at once on the demonstration page: time from the second click to both halves, and the server's memory.

Run: python benchmarks/record_people.py [PEOPLE] [CUTS] [BROWSER STROKES]

Every simulated person is a thread that sends what the page sends, with a pause of one to three seconds before each
stroke. It measures until both halves have arrived. With browser strokes, a real browser works beside them and measures
from the second click until the frame that shows both halves is drawn, in software. All run on this machine. Nothing
simulated here ever enters a data set that is kept: the folder is temporary, and its demonstrations say "test-robot".
"""

import http.client
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from cutgrammar.seeds import stream


class Person:
    """One simulated participant."""

    def __init__(self, port: int, number: int) -> None:
        self.port, self.rng = port, stream(0, "record people", number)
        joined = self.post("/api/join", {"code": f"sim{number}", "robot": True}, "")
        self.key, self.after, self.shown = joined["key"], joined["after"], joined
        self.previews: list[float] = []
        self.cuts: list[float] = []

    def post(self, path: str, message: dict[str, Any], key: str) -> Any:
        """Send a request as the page does."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        headers = {"Content-Type": "application/json", "Origin": f"http://127.0.0.1:{self.port}", "X-Session": key}
        connection.request("POST", path, json.dumps(message), headers)
        answer = connection.getresponse()
        content = json.loads(answer.read())
        return content if answer.status == 200 else None

    def work(self, cuts: int) -> None:
        """Make strokes across the whole board at random places, until `cuts` cuts are made."""
        for _ in range(20 * cuts):
            if len(self.cuts) >= cuts:
                return
            time.sleep(self.rng.uniform(1.0, 3.0))
            x = self.rng.uniform(-0.06, 0.06)
            eye = np.array([x, -0.9, 0.5])
            ends = np.array([[x, 0.15, 0.05], [x + 0.002, -0.15, 0.0]]) - eye
            message = {
                "eye": eye.tolist(),
                "first": ends[0].tolist(),
                "second": ends[1].tolist(),
                "explode": 0.0,
                "first_seconds": 1.0,
                "second_seconds": 2.0,
                "seconds": 3.0,
                "after": self.after,
                "robot": True,
            }
            began = time.perf_counter()
            halves = self.post("/api/preview", message, self.key)
            seconds = time.perf_counter() - began
            if halves is None:  # the stroke missed
                continue
            self.previews.append(seconds)
            began = time.perf_counter()
            made = self.post("/api/cut", message, self.key)
            if made is not None:
                self.cuts.append(time.perf_counter() - began)
                self.after = made["after"]


MEASURE = """() => {
    window.times = [];
    document.addEventListener("pointerup", () => { window.began = performance.now(); }, true);
    const drawn = () => {
        if (window.began) window.times.push(performance.now() - window.began);
        window.began = 0;
    };
    new MutationObserver(() => {
        if (document.body.dataset.state === "preview") requestAnimationFrame(() => requestAnimationFrame(drawn));
    }).observe(document.body, { attributes: true, attributeFilter: ["data-state"] });
}"""
BOX = """() => {
    const view = document.querySelector("#canvas").view;
    return view.boxOf([...view.fragments.keys()][0]);
}"""


def in_browser(address: str, strokes: int) -> list[float]:
    """Times [s] from the second click until a browser has drawn both halves; every stroke is then cancelled."""
    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.fill("#code", "browser")
        page.click("text=Start")
        page.wait_for_selector("body[data-state=ready]")
        page.evaluate(MEASURE)
        box = page.evaluate(BOX)
        for number in range(strokes):
            x = box["left"] + (0.3 + 0.4 * number / strokes) * (box["right"] - box["left"])
            page.mouse.click(x, box["top"] - 6)
            page.wait_for_timeout(1000)
            page.mouse.click(x + 3, box["bottom"] + 6)
            page.wait_for_selector("body[data-state=preview]")
            page.wait_for_timeout(1000)
            page.keyboard.press("Escape")
            page.wait_for_selector("body[data-state=ready]")
        times = [1e-3 * ms for ms in page.evaluate("() => window.times")]
        browser.close()
    return times


def main(n_people: int = 20, n_cuts: int = 6, browser_strokes: int = 0) -> None:
    """Measure and print one line each for previews, cuts, a browser and memory."""
    print("load of the machine before:", os.getloadavg()[0])
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "cutgrammar_pipelines", "record", "--out", f"{folder}/data", "--port", "0"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        line = next(line for line in server.stdout if line.startswith("the page is at "))
        address = line.removeprefix("the page is at ").strip().rstrip("/")
        people = [Person(int(address.rpartition(":")[2]), number) for number in range(n_people)]
        threads = [threading.Thread(target=person.work, args=(n_cuts,)) for person in people]
        for thread in threads:
            thread.start()
        drawn = in_browser(address, browser_strokes) if browser_strokes else []
        for thread in threads:
            thread.join()
        status = Path(f"/proc/{server.pid}/status").read_text()
        server.kill()
        server.wait()
    for name, times in (
        ("halves arrived", [t for p in people for t in p.previews]),
        ("cut kept", [t for p in people for t in p.cuts]),
        ("halves drawn in the browser", drawn),
    ):
        if not times:
            continue
        ms = 1e3 * np.array(times)
        print(f"{name}: {len(ms)} times, median {np.median(ms):.0f} ms, 95th percentile {np.percentile(ms, 95):.0f} ms")
    print(
        "memory of the server:",
        next(row for row in status.splitlines() if row.startswith("VmHWM")).split(":")[1].strip(),
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
