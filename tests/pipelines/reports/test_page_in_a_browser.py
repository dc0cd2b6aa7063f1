"""The page of a report in a real browser, opened as a file: what can be turned, on a desktop and on a phone."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from browser import browser
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import Ledger, read_configurations, read_records
from cutgrammar.storage.run_folder import ledger_of, recording_of, settle_run
from cutgrammar.trials.scoring import score
from cutgrammar_pipelines.config import ReportConfig
from cutgrammar_pipelines.reports.build import report

pytestmark = pytest.mark.slow

HIDE_WEBGL = """
const real = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
  return kind.startsWith("webgl") ? null : real.call(this, kind, ...rest);
};
"""


def halves(mesh, share):
    """A mesh cut across its longest axis, where it lies."""
    low, high = mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()
    plane = Plane.through(np.array([0.0, 0.0, low + share * (high - low)]), np.array([0.0, 0.0, 1.0]))
    return tuple(Fragment(product, Pose.identity()) for product in slice_mesh(mesh, plane).products)


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def run(made, tmp_path_factory):
    """A run of two methods whose trials each cut one lump in two, with a recording of one."""
    facts = made.facts_of()
    folder = tmp_path_factory.mktemp("report") / "my run"
    ball = trimesh.creation.icosphere(2, 0.03)
    lump = Mesh(ball.vertices * [1.0, 1.3, 2.0] + 0.002 * np.cos(45 * ball.vertices), ball.faces)
    settle_run(folder, facts)
    goal = halves(lump, 0.5)
    with Ledger(ledger_of(folder)) as ledger:
        for n, record in enumerate(made.records_of(facts, methods=["grammar", "random"], trials=1, runs=1)):
            reached = halves(lump, 0.3 + 0.05 * n)
            found = score(reached, goal)
            event = made.scored_event(found.pairs)
            configurations = TrialConfigurations((Fragment(lump, Pose.identity()),), goal, reached)
            ledger.add(replace(record, scores=found.scores, events=(event,), status="done"), configurations)
    recording = recording_of(folder, "N1M1-0-in-place-grammar-0-bench-truth")
    recording.parent.mkdir()
    recording.touch()
    return folder


@pytest.fixture(scope="module")
def address(run):
    page = run.parent / "pages" / "report.html"
    assert report(ReportConfig([run], out=page)) in (0, 1)
    return page.as_uri()


def opened(context, address):
    """The page, and lists of what it asks for and of what goes wrong."""
    page, requests, problems = context.new_page(), [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.goto(address)
    return page, requests, problems


def unfold(page):
    page.evaluate("document.querySelectorAll('details').forEach((fold) => { fold.open = true; })")


def eyes(trial):
    """Where each view of a trial is seen from."""
    return np.array(trial.evaluate("(figure) => figure.turnable.views.map((view) => view.camera.position.toArray())"))


def pixels(trial, number):
    """The picture of a view, as bytes."""
    return trial.locator("canvas").nth(number).screenshot()


def test_a_trial_is_turned_with_the_mouse_and_all_its_views_turn_together(chromium, address, run):
    page, requests, problems = opened(chromium.new_context(viewport={"width": 1280, "height": 900}), address)
    trial = page.locator("figure.trial").first
    trial.locator("button.turn").click()
    trial.locator("canvas").nth(2).wait_for(timeout=30_000)
    page.locator("figure.trial[data-state=open]").wait_for(timeout=30_000)
    assert trial.locator(".panels p").all_inner_texts() == ["goal", "reached", "matched pairs"]
    page.wait_for_timeout(500)
    before, seen = eyes(trial), [pixels(trial, n) for n in range(3)]
    np.testing.assert_allclose(before, before[:1].repeat(3, axis=0))
    box = trial.locator("canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 90, y + 25, steps=6)
    page.mouse.up()
    page.wait_for_timeout(500)
    after = eyes(trial)
    assert np.linalg.norm(after[0] - before[0]) > 0.05
    np.testing.assert_allclose(after, after[:1].repeat(3, axis=0))
    assert all(pixels(trial, n) != seen[n] for n in range(3))
    canvas = trial.locator("canvas").nth(1)
    canvas.press("ArrowLeft")
    assert np.linalg.norm(eyes(trial)[2] - after[2]) > 0.02
    canvas.press("Escape")
    assert trial.locator("canvas").count() == 0
    assert trial.locator(".still img").is_visible()
    assert problems == []
    assert requests == [address]


def test_many_trials_are_open_at_once_with_one_context(chromium, address):
    page, _, problems = opened(chromium.new_context(), address)
    unfold(page)
    trials = page.locator("figure.trial")
    assert trials.count() == 6
    for trial in trials.all():
        trial.locator("button.turn").click()
        trial.locator("canvas").nth(2).wait_for(timeout=30_000)
    page.wait_for_timeout(500)
    assert (
        len(
            {
                trial.evaluate("(figure) => figure.turnable.views[0].renderer.id ??= Math.random()")
                for trial in trials.all()
            }
        )
        == 1
    )
    assert problems == []


def test_a_trial_is_linked_to_its_recording_and_its_command_is_copied(chromium, address, run):
    context = chromium.new_context()
    page, _, _ = opened(context, address)
    name = "N1M1-0-in-place-grammar-0-bench-truth"
    trial = page.locator(f"figure.trial[data-name='{name}']")
    assert trial.locator("a").get_attribute("href") == f"../my%20run/recordings/{name}.rrd"
    page.evaluate("navigator.clipboard.writeText = async (text) => { document.title = text; }")
    trial.get_by_role("button", name="Copy the command").click()
    assert page.title() == f"cutgrammar view '{run}' {name}"


def test_on_a_phone_nothing_is_wider_than_the_page_and_a_finger_turns(chromium, address):
    context = chromium.new_context(viewport={"width": 360, "height": 740}, has_touch=True, is_mobile=True)
    page, _, problems = opened(context, address)
    unfold(page)
    trial = page.locator("figure.trial").first
    trial.locator("button.turn").tap()
    page.locator("figure.trial[data-state=open]").wait_for(timeout=30_000)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    trial.locator("canvas").first.scroll_into_view_if_needed()
    before = eyes(trial)
    box = trial.locator("canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch = context.new_cdp_session(page)
    for kind, shift in (("touchStart", 0), ("touchMove", 20), ("touchMove", 60), ("touchEnd", None)):
        points = [] if shift is None else [{"x": x + shift, "y": y}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    page.wait_for_timeout(300)
    after = eyes(trial)
    assert np.linalg.norm(after[0] - before[0]) > 0.02
    np.testing.assert_allclose(after, after[:1].repeat(3, axis=0))
    assert problems == []


@pytest.fixture(scope="module")
def beside(run, made):
    """The page of the run beside a second one of the same trials, whose cuts are elsewhere."""
    other = run.parent / "other run"
    settle_run(other, facts := made.facts_of(seed=made.facts_of().seed + 1))
    with Ledger(ledger_of(other)) as ledger:
        for record in read_records(ledger_of(run)):
            known = read_configurations(ledger_of(run), record.key)
            reached = halves(known.start[0].shape, 0.42)
            found = score(reached, known.goal)
            event = made.scored_event(found.pairs)
            key = replace(record.key, origin=facts.origin)
            ledger.add(replace(record, key=key, scores=found.scores, events=(event,)), replace(known, reached=reached))
    page = run.parent / "pages" / "both.html"
    assert report(ReportConfig([run], beside=[other], out=page)) in (0, 1)
    return page.as_uri()


@pytest.mark.parametrize("device", ["desktop", "phone"])
def test_the_results_of_two_runs_and_their_goal_turn_together(chromium, beside, device):
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    context = chromium.new_context(**phone if device == "phone" else {"viewport": {"width": 1280, "height": 900}})
    page, requests, problems = opened(context, beside)
    section = page.locator("h2", has_text="The same trials of both")
    trial = section.locator("xpath=following::figure[contains(@class, 'trial')]").first
    assert trial.locator(".result strong").all_inner_texts() == ["my run", "other run"]
    trial.locator("button.turn").click()
    page.locator("figure.trial[data-state=open]").wait_for(timeout=30_000)
    titles = ["goal", "my run", "other run", "matched pairs, my run", "matched pairs, other run"]
    assert trial.locator(".panels p").all_inner_texts() == titles
    page.wait_for_timeout(500)
    before, seen = eyes(trial), [pixels(trial, n) for n in range(3)]
    np.testing.assert_allclose(before, before[:1].repeat(len(before), axis=0))
    canvas = trial.locator("canvas").nth(2)  # of the second run
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 70, y + 20, steps=6)
    page.mouse.up()
    page.wait_for_timeout(500)
    after = eyes(trial)
    assert np.linalg.norm(after[0] - before[0]) > 0.05
    np.testing.assert_allclose(after, after[:1].repeat(len(after), axis=0))
    assert all(pixels(trial, n) != seen[n] for n in range(3))
    assert page.evaluate("document.documentElement.scrollWidth") <= context.pages[0].viewport_size["width"]
    assert problems == []
    assert requests == [beside]


def test_a_report_of_every_condition_and_method_is_no_wider_than_a_phone(chromium, made, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts, goals=["in-place", "scattered", "foreign"])
    run = made.write_run(tmp_path / "a run whose name is rather long", facts, records, records)
    assert report(ReportConfig([run], out=tmp_path / "page.html")) == 0
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page, _, problems = opened(context, (tmp_path / "page.html").as_uri())
    assert page.locator("h2").count() >= 5
    unfold(page)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    for table in page.locator(".wide").all():  # what is wider goes on within its frame
        assert table.evaluate("(frame) => frame.clientWidth") <= 390
        assert table.evaluate("(frame) => getComputedStyle(frame).overflowX") == "auto"
    assert problems == []


def test_without_webgl_the_pictures_remain(chromium, address):
    context = chromium.new_context()
    context.add_init_script(HIDE_WEBGL)
    page, _, problems = opened(context, address)
    assert page.get_by_text("This browser shows no WebGL").is_visible()
    assert page.locator("button.turn:visible").count() == 0
    assert page.locator("figure.trial img").first.is_visible()
    assert problems == []
