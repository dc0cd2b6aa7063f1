"""The demonstration page in a real browser, and a server that dies."""

import http.client
import json
import resource
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

from browser import browser
from cutgrammar.learning.model import load_model
from cutgrammar.storage.data_set import DataSet
from cutgrammar.trials.scoring import score
from cutgrammar_pipelines.config import CollectConfig, SplitConfig, TrainConfig
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import train
from short_training import SHORT

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
        before = [line := self.process.stdout.readline()]
        while "the page is at" not in line and line:
            before.append(line := self.process.stdout.readline())
        assert line, before
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
    started = Server(tmp_path / "data", "--trials", 12, "--setups", "N1M1")
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
        const view = document.querySelector("#canvas").view;
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


def cut(page, numbers, press, confirm, look=lambda number: None):
    """Cut until there is each of these numbers of fragments; `confirm` presses a button, after a look at the halves."""
    for number in numbers:
        stroke(page, press)
        look(number)
        confirm("#cut")
        fragments(page, number)
        state(page, "ready")


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

    def turn(number):
        if number == 3:
            page.mouse.move(640, 300)
            page.mouse.down()
            page.mouse.move(700, 340, steps=4)  # halves may be looked at from all sides before the cut
            page.mouse.up()
            page.click("[data-view=front]")

    cut(page, range(2, 7), page.mouse.click, page.click, turn)
    page.click("#undo")
    fragments(page, 5)
    page.click("#save")
    page.wait_for_selector("#saved[open]")
    assert "1 of 12" in page.inner_text("#saved-text")
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
    cut(page, (2, 3), page.touchscreen.tap, page.tap)
    page.tap("#save")
    page.wait_for_selector("#saved[open]")
    context.close()
    assert len(DataSet.open(server.out).demonstration(0).goal) == 3


def test_a_killed_server_offers_the_open_demonstration_at_its_last_cut(server, chromium):
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    enter(page, server, "P08")
    cut(page, (2, 3), page.mouse.click, page.click)
    stroke(page, page.mouse.click)
    server.kill()
    page.click("#cut")  # the request of the third cut meets no server
    state(page, "lost")
    assert "Your cuts so far are kept" in page.inner_text("#message")
    server.start()
    state(page, "ready")
    assert "continue at your last cut" in page.inner_text("#message")
    fragments(page, 3)
    server.kill()
    server.start()
    page.reload()  # another way back: the page is opened again
    page.fill("#code", "P08")
    page.click("text=Start")
    page.wait_for_selector("#resumed[open]")
    assert "2 cuts" in page.inner_text("#resumed-text")
    page.click("#continue")
    stroke(page, page.mouse.click)
    page.click("#cut")
    fragments(page, 4)
    page.click("#save")
    page.wait_for_selector("#saved[open]")
    page.close()
    made = DataSet.open(server.out).demonstration(0)
    assert len(made.goal) == 4
    assert [cut.undone for cut in made.cuts] == [False] * 3


def test_the_page_tells_of_a_full_disk_and_continues_when_there_is_room(server, chromium):
    """The kernel refuses the server's process to write, as on a full disk."""
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    enter(page, server, "P09")
    cut(page, (2,), page.mouse.click, page.click)
    journal = server.out / "sessions" / "trial-00000.jsonl"
    kept = journal.read_bytes()
    _, most = resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (len(kept) + 20, most))
    stroke(page, page.mouse.click)
    for button in ("#cut", "#undo", "#save"):
        if button == "#undo":
            page.click("#cancel")
        page.click(button)
        page.wait_for_selector("#message:text-matches('the disk of the server is full')")
        assert "What you did before is kept" in page.inner_text("#message")
        assert journal.read_bytes() == kept
    resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (most, most))
    cut(page, (3,), page.mouse.click, page.click)
    page.click("#save")
    page.wait_for_selector("#saved[open]")
    page.close()
    assert len(DataSet.open(server.out).demonstration(0).goal) == 3


STROKE = {"eye": [0.0, -1.0, 0.5], "first": [0.0, 1.05, -0.4], "second": [0.0, 0.9, -0.5], "explode": 0.0}


def test_a_server_killed_at_any_moment_of_a_save_loses_nothing_saved(server):
    """It is killed at four moments from before to after the answer; whoever was answered finds their work."""
    times = {"first_seconds": 1.0, "second_seconds": 2.0, "robot": True}
    answered = set()
    for attempt in range(4):
        code = f"K{attempt}"
        _, joined = server.post("/api/join", {"code": code, "robot": True})
        if joined["task"] is None:
            break
        trial, key = joined["task"]["trial"], joined["key"]
        status, made = server.post("/api/cut", STROKE | times | {"after": joined["after"], "seconds": 3.0}, key)
        assert status == 200, made
        timer = threading.Timer(0.006 * attempt, server.process.send_signal, [signal.SIGKILL])
        timer.start()
        try:
            saved, _ = server.post("/api/save", {"after": made["after"], "seconds": 4.0, "robot": True}, key)
            answered |= {trial} if saved == 200 else set()
        except (OSError, http.client.HTTPException):
            pass  # it died first
        timer.join()
        server.kill()
        server.start()
        kept = (
            {one.trial for one in DataSet.open(server.out).trials} if (server.out / "manifest.json").exists() else set()
        )
        assert answered <= kept
        for one in kept:
            assert len(DataSet.open(server.out).demonstration(one).goal) == 2


def test_demonstrations_by_hand_train_together_with_scripted_ones(server, tmp_path):
    times = {"first_seconds": 1.0, "second_seconds": 2.0, "robot": True}
    for number in range(3):
        _, joined = server.post("/api/join", {"code": f"T{number}", "robot": True})
        key = joined["key"]
        _, made = server.post("/api/cut", STROKE | times | {"after": joined["after"], "seconds": 3.0}, key)
        assert server.post("/api/save", {"after": made["after"], "seconds": 4.0, "robot": True}, key)[0] == 200
    scripted, both = tmp_path / "scripted", tmp_path / "both"
    collect(CollectConfig(out=scripted, trials=10, seed=4, setups=["N1M1"], workers=0))
    split(SplitConfig([scripted, server.out], out=both, rule="share", share=0.9))
    train(TrainConfig(data=both, split="share", out=tmp_path / "model", settings=SHORT))
    trials = DataSet.open(both).trials
    assert [one.demonstrator for one in trials] == ["scripted"] * 10 + [f"test-robot T{n}" for n in range(3)]
    assert set(load_model(tmp_path / "model").provenance.trials) & {10, 11, 12}


def test_people_reproduce_the_test_goals_of_a_data_set(chromium, tmp_path):
    data, out = tmp_path / "goals", tmp_path / "people"
    collect(CollectConfig(out=data, trials=6, seed=4, setups=["N1M1", "N2M1"], workers=0))
    split(SplitConfig([data], out=data))
    server = Server(out, "--reproduce", data, "--trials", 3)
    try:
        page = chromium.new_page(viewport={"width": 1280, "height": 800})
        enter(page, server, "P1")
        cameras = """() => ["canvas", "goal"].map((id) => document.getElementById(id).view.camera.position.toArray())"""
        board, goal = page.evaluate(cameras)
        assert board == goal
        page.mouse.move(1100, 500)
        page.mouse.down()
        page.mouse.move(1180, 520, steps=3)
        page.mouse.up()
        board, turned = page.evaluate(cameras)
        assert board == turned != goal
        page.keyboard.press("1")
        stroke(page, page.mouse.click)
        page.keyboard.press("Enter")
        fragments(page, 2)
        page.keyboard.press("s")
        page.wait_for_selector("#saved[open]")
        page.close()
    finally:
        server.kill()
    made = DataSet.open(out).demonstration(DataSet.open(out).trials[0].trial)
    shown = DataSet.open(data).demonstration(made.trial)
    assert made.foods == shown.foods
    assert np.array_equal(made.start[0].mesh.vertices, shown.start[0].mesh.vertices)
    assert 0.0 < score(made.goal, shown.goal).scores["iou_strict"] <= 1.0
