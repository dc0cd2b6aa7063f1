"""The demonstration page in a real browser, and a server that dies."""

import json
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from browser import browser
from cutgrammar.storage.data_set import DataSet

pytestmark = pytest.mark.slow


class Server:
    """`cutgrammar record` as a process of its own."""

    def __init__(self, out, *words):
        self.out, self.words, self.port = out, [str(word) for word in words], 0
        self.start()

    def start(self):
        command = [sys.executable, "-m", "cutgrammar_pipelines", "record", "--out", str(self.out)]
        self.process = subprocess.Popen(
            [*command, "--port", str(self.port), *self.words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        line = self.process.stdout.readline()
        assert "the page is at" in line, line + self.process.stdout.read()
        self.address = line.split("the page is at ")[1].strip().rstrip("/")
        self.port = int(self.address.rpartition(":")[2])

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()

    def post(self, path, message, key=""):
        headers = {"Content-Type": "application/json", "Origin": self.address, "X-Session": key}
        request = urllib.request.Request(self.address + path, json.dumps(message).encode(), headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            return error.code, json.load(error)


@pytest.fixture
def server(tmp_path):
    started = Server(tmp_path / "data", "--trials", 3, "--setups", "N1M1")
    yield started
    started.kill()


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


def state(page, name):
    page.wait_for_selector(f"body[data-state={name}]", timeout=20_000)


def enter(page, server, code):
    page.goto(server.address)
    page.fill("#code", code)
    page.click("text=Start")
    state(page, "ready")


def largest(page):
    """The rectangle of the widest fragment on the page, as shown."""
    return page.evaluate(
        """() => {
        const view = document.querySelector("canvas").view;
        const boxes = [...view.fragments.keys()].map((id) => view.boxOf(id));
        return boxes.reduce((a, b) => (b.right - b.left > a.right - a.left ? b : a));
        }"""
    )


def stroke(page, press, share=0.5):
    """Two clicks across the widest fragment; `press` is what clicks at a place."""
    box = largest(page)
    x = box["left"] + share * (box["right"] - box["left"])
    press(x, box["top"] - 6)
    state(page, "first")
    press(x + 3, box["bottom"] + 6)
    state(page, "preview")


def fragments(page, number):
    page.wait_for_selector(f"#count:text-matches('^{number} fragment')", timeout=20_000)


def test_a_person_cuts_with_the_mouse_and_the_result_is_a_data_set(server, chromium):
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    problems = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    enter(page, server, "P07")
    for number in range(5):
        stroke(page, page.mouse.click)
        if number == 1:
            page.mouse.move(640, 300)
            page.mouse.down()
            page.mouse.move(700, 340, steps=4)  # halves may be looked at from all sides before the cut
            page.mouse.up()
            page.click("[data-view=front]")
        page.click("#cut")
        fragments(page, number + 2)
        state(page, "ready")
    page.click("#undo")
    fragments(page, 5)
    page.click("#save")
    page.wait_for_selector("#saved[open]")
    assert "1 of 3" in page.inner_text("#saved-text")
    assert problems == []
    assert all(url.startswith((server.address, "data:")) for url in requests)
    page.click("#next")
    state(page, "ready")
    page.close()

    data = DataSet.open(server.out)
    assert [trial.trial for trial in data.trials] == [0]
    made = data.demonstration(0)
    assert made.demonstrator == "test-robot P07"
    assert [cut.undone for cut in made.cuts] == [False] * 4 + [True]
    assert len(made.goal) == 5
    assert len(made.strokes) == 5
    assert made.strokes[4].undone_seconds is not None
    for one in made.strokes:
        assert 0.0 < one.first_seconds < one.second_seconds < one.cut_seconds
    assert sum(f.mesh.volume for f in made.goal) == pytest.approx(made.start[0].mesh.volume)


def test_a_person_cuts_with_a_finger(server, chromium):
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    enter(page, server, "phone")
    for number in range(2):
        stroke(page, page.touchscreen.tap)
        page.tap("#cut")
        fragments(page, number + 2)
        state(page, "ready")
    page.tap("#save")
    page.wait_for_selector("#saved[open]")
    context.close()
    assert len(DataSet.open(server.out).demonstration(0).goal) == 3
