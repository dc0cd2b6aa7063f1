"""The rating page in a real browser, a server that dies, and what reports make of the ratings."""

import json
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from browser import browser
from cutgrammar.errors import InputError
from cutgrammar.results.rater_agreement import ordinal_alpha
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import Ledger
from cutgrammar.storage.ratings import last_answers, read_ratings
from cutgrammar.storage.run_folder import ledger_of, settle_run
from cutgrammar.trials.rating_plan import RESULT
from cutgrammar_pipelines.config import RateConfig
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.stages.rate import open_panel, pool_of


@pytest.fixture
def run(made, tmp_path, halved):
    """A run of three methods on four goals in two setups, whose configurations are known."""
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1", "N2M1"], methods=["grammar", "largest", "random"], runs=1)
    folder = tmp_path / "run"
    settle_run(folder, facts)
    with Ledger(ledger_of(folder)) as ledger:
        ledger.plan(record.key for record in records)
        for record in records:
            number = 2 + 5 * (record.key.trial % 2)
            record = made.record_for(record.key, record.scores["iou"], goal_fragments=number, fragments=2)
            ledger.add(record, TrialConfigurations(row_of(1), row_of(number), row_of(2)))
    return folder


def row_of(number):
    """`number` blocks in a row."""
    import trimesh

    from cutgrammar.geometry.fragment import Fragment, Mesh
    from cutgrammar.geometry.pose import Pose

    box = trimesh.creation.box((0.14 / number - 0.004, 0.03, 0.02))
    mesh = Mesh(box.vertices, box.faces)
    places = 0.14 * ((np.arange(number) + 0.5) / number - 0.5)
    return tuple(Fragment(mesh, Pose(np.eye(3), np.array([x, 0.0, 0.01]))) for x in places)


class Server:
    """`cutgrammar rate` as a process of its own."""

    def __init__(self, run, store, *words):
        self.run, self.words, self.port = run, [str(word) for word in words], 0
        self.environment = {"MLFLOW_TRACKING_URI": f"sqlite:///{store}", "PATH": "/usr/bin:/bin"}
        self.start()

    def start(self):
        command = [sys.executable, "-m", "cutgrammar_pipelines", "rate", str(self.run), "--port", str(self.port)]
        self.process = subprocess.Popen(
            [*command, *self.words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=self.environment
        )
        before = [line := self.process.stdout.readline()]
        while "the page is at" not in line and line:
            before.append(line := self.process.stdout.readline())
        self.said = before[:-1]
        assert line, before
        self.address = line.split("the page is at ")[1].strip().rstrip("/")
        self.port = int(self.address.rpartition(":")[2])

    def kill(self, how=signal.SIGKILL):
        self.process.send_signal(how)
        said, _ = self.process.communicate(timeout=120)
        return said


@pytest.fixture
def server(run, tmp_path):
    started = Server(run, tmp_path / "mlflow.db", "--pairs", 10)
    yield started
    if started.process.poll() is None:
        started.kill()


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


def state(page, name):
    page.wait_for_selector(f"body[data-state={name}]", timeout=30_000)


def enter(page, server, code):
    page.goto(server.address)
    page.fill("#code", code)
    page.click("text=Start")
    state(page, "ready")


def shown(page, answered):
    page.wait_for_selector(f"#progress-text:text-matches('^{answered} of')", timeout=30_000)
    page.wait_for_selector("body[data-state=ready], body[data-state=done]", timeout=30_000)


@pytest.mark.slow
def test_a_person_rates_with_keys_and_clicks_reloads_and_resumes_after_the_server_died(server, chromium, run):
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    problems = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    enter(page, server, "P1")
    cameras = """() => ["goal", "result"].map((id) => document.getElementById(id).view.camera.position.toArray())"""
    goal, result = page.evaluate(cameras)
    assert goal == result
    page.mouse.move(900, 400)
    page.mouse.down()
    page.mouse.move(980, 420, steps=3)
    page.mouse.up()
    goal, turned = page.evaluate(cameras)
    assert goal == turned != result  # both views are turned together
    for number in range(3):
        page.keyboard.press(str(number + 1))
        shown(page, number + 1)
    for number in range(3, 6):
        page.click(f"[data-rating='{number}']")
        shown(page, number + 1)
    page.keyboard.press("b")
    page.wait_for_selector("#message:text-is('You gave 5. Rate again to change it.')")
    state(page, "ready")
    page.keyboard.press("1")
    shown(page, 6)
    page.reload()
    assert page.input_value("#code") == "P1"
    page.click("text=Start")
    shown(page, 6)
    server.kill()
    page.keyboard.press("4")  # meets no server
    state(page, "lost")
    assert "Your ratings so far are kept" in page.inner_text("#message")
    server.start()
    shown(page, 6)
    for number in range(6, 12):
        page.keyboard.press("4")
        shown(page, number + 1)
    page.wait_for_selector("#done[open]")
    assert problems == []
    page.close()

    kept = read_ratings(run)
    assert [one.rating for one in kept] == [1, 2, 3, 3, 4, 5, 1, *[4] * 6]
    assert [one.answer for one in kept] == [1] * 6 + [2] + [1] * 6
    last = last_answers(kept)
    assert len({one.pair for one in last}) == len(last) == 12
    assert sum(one.kind == RESULT for one in last) == 10
    assert all(one.robot for one in kept)  # playwright is no person
    said = server.kill(signal.SIGINT)
    assert "rater P1: 10 pairs, 2 checks; does not count: a test robot" in said
    report = build_report([run])
    assert "ratings of P1 do not count: a test robot" in report.notes
    assert all(row["human_rating_mean"] is None for row in report.to_json()["rows"])


@pytest.mark.slow
def test_a_person_rates_on_a_phone(server, chromium, run):
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    enter(page, server, "phone")
    for number in range(2):
        page.tap(f"[data-rating='{number + 3}']")
        shown(page, number + 1)
    page.tap("#back")
    page.wait_for_selector("#message:text-is('You gave 4. Rate again to change it.')")
    context.close()
    assert [one.rating for one in read_ratings(run)] == [3, 4]


@pytest.mark.slow
def test_on_a_phone_and_a_desktop_no_button_covers_the_pictures(server, chromium):
    for width, height in ((390, 844), (360, 640), (1280, 800)):
        page = chromium.new_page(viewport={"width": width, "height": height})
        enter(page, server, f"W{width}")
        pictures = [page.locator(name).bounding_box() for name in ("#goal", "#result")]
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for button in page.locator("button:visible").all():
            box = button.bounding_box()
            assert 0 <= box["x"] <= width - box["width"]
            for picture in pictures:
                assert box["y"] >= picture["y"] + picture["height"] - 1, (width, button.inner_text())
        page.click("[data-view=top]")
        page.close()


@pytest.mark.slow
def test_quiet_says_the_address_and_nothing_else(run, tmp_path):
    for words, said in (
        ((), ["12 results can be rated; each person is shown 5 and 2 attention checks\n"]),
        (["--quiet"], []),
    ):
        server = Server(run, tmp_path / "mlflow.db", "--pairs", 5, *words)
        assert server.said == said
        ended = r"cutgrammar rate: interrupted; run the same command again, it resumes: (\S*/)?cutgrammar rate "
        assert re.match(ended, server.kill(signal.SIGINT))


def answer_all(panel, code, rating_of):
    """A person who answers all their pairs, checks included, as `rating_of` says."""
    _, rater = panel.join(code)
    for pair in rater.pairs:
        expected = {"same": 5, "other": 1}
        rating = expected.get(pair.kind) or rating_of(pair)
        panel.answer(rater, panel.name(rater, pair), rater.answers, rating, 2.0, False)
    return rater


def test_three_raters_of_a_run_have_alpha_and_a_rating_for_every_method(run):
    config = RateConfig([run], pairs=12)
    levels = {"grammar": 4, "largest": 3, "random": 1}
    with open_panel(config, pool_of(config.runs)) as panel:
        for number, code in enumerate("ABC"):
            answer_all(panel, code, lambda p, n=number: min(5, levels[p.key.method] + (n == p.key.trial % 3)))
    kept = last_answers(read_ratings(run))
    assert len({(one.rater, one.pair) for one in kept}) == len(kept) == 3 * 14
    counts = {}
    for one in kept:
        if one.kind == RESULT:
            counts.setdefault(one.pair, np.zeros(5))[one.rating - 1] += 1
    built = build_report([run]).to_json()
    assert built["human_rating"]["alpha"] == pytest.approx(ordinal_alpha(list(counts.values())))
    assert built["human_rating"]["shared_pairs"] == 12  # there are only twelve results, so that all rate the same
    means = {row["method"]: row["human_rating_mean"] for row in built["rows"] if row["setup"] == "all"}
    assert means["grammar"] > means["largest"] > means["random"] > 1.0


def test_a_second_server_on_the_same_run_is_refused(run):
    config = RateConfig([run])
    with open_panel(config, pool_of(config.runs)), pytest.raises(InputError, match="rated on another server"):
        open_panel(config, pool_of(config.runs)).__enter__()


def test_methods_can_be_chosen_and_unknown_ones_are_named(run):
    assert {one.key.method for one in pool_of([run], ["random"]).records} == {"random"}
    with pytest.raises(InputError, match="nonsense"):
        pool_of([run], ["nonsense"])


def test_a_run_without_fragments_cannot_be_rated(scored_run):
    with pytest.raises(InputError, match="hold no fragments"):
        pool_of([scored_run])
    assert json.loads((scored_run / "run.json").read_bytes())["schema"] == 2
