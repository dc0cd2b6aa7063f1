"""The rating page behind its guard: blind, one answer a pair, back, resumed, and what it refuses."""

import json
import re
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient

from cutgrammar.plugins import METHODS, names_in
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ratings import RatingStore, last_answers, ratings_of, read_ratings
from cutgrammar.trials.rating_plan import OTHER, RESULT, SAME, Pair
from cutgrammar.trials.record import TrialKey
from cutgrammar_dashboards.pages.access import access_to
from cutgrammar_dashboards.pages.guard import MAX_BODY, Guard
from cutgrammar_dashboards.rating.app import rating_page
from cutgrammar_dashboards.rating.panel import Panel
from cutgrammar_dashboards.rating.shown_pair import ShownPairs

HOME = "http://127.0.0.1:8766"
KEYS = [
    TrialKey("N1M1", trial, "in-place", method, 0, "bench", "truth", "0" * 64)
    for trial, method in enumerate(["grammar", "bc", "qnet"])
]
PAIRS = [*(Pair(RESULT, key) for key in KEYS), Pair(SAME, KEYS[1]), Pair(OTHER, KEYS[0], KEYS[2])]


class Page:
    """A server of its own on the ratings in a folder; every answer that it gives is kept."""

    def __init__(self, folder, story):
        start, goal, events = story
        self.store = RatingStore(ratings_of(folder))
        self.finished = []
        stores = {key.digest: self.store for key in KEYS}
        panel = Panel(stores, {p.digest: p for p in PAIRS}, lambda code: PAIRS, lambda: self.finished.append(1))
        shown = ShownPairs(lambda key: TrialConfigurations(start, goal, events[-2].configuration))
        self.client = TestClient(Guard(rating_page(panel, shown), access_to("127.0.0.1", 8766)), base_url=HOME)
        self.bodies = []

    def post(self, path, message, key="", **headers):
        content = message if isinstance(message, bytes) else json.dumps(message)
        own = {"Content-Type": "application/json", "Origin": HOME, "X-Session": key}
        answer = self.client.post(path, content=content, headers=own | headers)
        self.bodies.append(answer.content)
        return answer

    def get(self, path, key=""):
        answer = self.client.get(path, headers={"X-Session": key})
        self.bodies.append(answer.content)
        return answer

    def join(self, code, robot=False):
        return self.post("/api/join", {"code": code, "robot": robot}).json()

    def rate(self, state, value, key, robot=False, **changes):
        message = {"after": state["after"], "pair": state["pair"], "rating": value, "seconds": 1.5, "robot": robot}
        return self.post("/api/rate", message | changes, key)


@pytest.fixture
def page(tmp_path, story):
    opened = Page(tmp_path, story)
    yield opened
    opened.store.close()


def test_a_rater_rates_all_pairs(page, tmp_path):
    state = page.join("P1")
    key = state["key"]
    for number, pair in enumerate(PAIRS):
        assert (state["place"], state["answered"], state["pairs"]) == (number, number, 5)
        assert page.finished == []
        state = page.rate(state, 1 + number, key).json()
        assert read_ratings(tmp_path)[-1].pair == pair.digest
    assert state == {"place": 5, "pairs": 5, "after": 5, "answered": 5}
    assert page.finished == [1]
    assert [one.rating for one in read_ratings(tmp_path)] == [1, 2, 3, 4, 5]
    assert {one.robot for one in read_ratings(tmp_path)} == {False}


def test_nothing_that_the_browser_gets_names_a_method_or_a_trial(page):
    state = page.join("P1")
    key = state["key"]
    while "pair" in state:
        state = page.rate(state, 3, key).json()
    page.get("/api/pair/0", key)
    page.get("/")
    for file in ("rate.js", "rate.css", "page.css", "server.js"):
        page.get(f"/static/{file}")
    said = b"\n".join(page.bodies).lower().replace(b"cutgrammar", b"")
    assert len(said) > 10_000
    forbidden = {*names_in(METHODS), "n1m1", "bench", "in-place", *(key.digest for key in KEYS)} - {"copy", "random"}
    forbidden |= {pair.digest for pair in PAIRS} | {pair.digest[:24] for pair in PAIRS}
    said = re.sub(rb'"(key|pair)": "[^"]*"', b"", said)  # these are random, and may spell a short name
    for name in forbidden:
        assert not re.search(rb"(?<![a-z0-9])%b(?![a-z0-9])" % re.escape(name.encode()), said), name
    for body in page.bodies:
        if body.startswith(b'{"place"'):
            fields = set(json.loads(body))
            assert fields <= {"place", "pairs", "after", "answered", "key", "pair", "rating", "goal", "result"}


def test_checks_cannot_be_told_from_results_by_their_fields(page):
    state = page.join("P1")
    key, shapes = state.pop("key"), []
    while "pair" in state:
        meshes = [mesh for side in ("goal", "result") for mesh in state[side]["new"].values()]
        shapes.append((sorted(state), len(state["pair"]), {tuple(sorted(mesh)) for mesh in meshes}))
        state = page.rate(state, 3, key).json()
    assert len(shapes) == len(PAIRS)
    assert all(shape == shapes[0] for shape in shapes)


def test_names_of_pairs_differ_between_raters_and_servers(page, tmp_path, story):
    first, second = page.join("P1")["pair"], page.join("P2")["pair"]
    page.store.close()
    again = Page(tmp_path, story)
    assert len({first, second, again.join("P1")["pair"]}) == 3
    again.store.close()


def test_a_rater_may_change_their_mind_and_both_answers_are_kept(page, tmp_path):
    state = page.join("P1")
    key = state["key"]
    state = page.rate(state, 2, key).json()
    before = page.get("/api/pair/0", key).json()
    assert before["rating"] == 2
    state = page.rate(before, 5, key).json()
    assert (state["place"], state["answered"], state["after"]) == (1, 1, 2)
    kept = read_ratings(tmp_path)
    assert [(one.rating, one.answer) for one in kept] == [(2, 1), (5, 2)]
    assert [one.rating for one in last_answers(kept)] == [5]


def test_a_replayed_rating_is_refused(page, tmp_path):
    state = page.join("P1")
    key = state["key"]
    assert page.rate(state, 2, key).status_code == 200
    again = page.rate(state, 4, key)
    assert again.status_code == 409
    assert "out of date" in again.json()["problem"]
    assert [one.rating for one in read_ratings(tmp_path)] == [2]


def test_a_pair_that_was_not_shown_is_refused(page, tmp_path):
    state, other = page.join("P1"), page.join("P2")
    key = state["key"]
    assert page.rate(state, 2, key, pair=other["pair"]).status_code == 422  # of another rater
    assert page.rate(state, 2, key, pair="0" * 24).status_code == 422
    assert page.get("/api/pair/1", key).status_code == 422  # the next one
    assert page.get("/api/pair/-1", key).status_code == 422
    assert page.get("/api/pair/../../etc/passwd", key).status_code == 404
    assert read_ratings(tmp_path) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"rating": 0},
        {"rating": 6},
        {"rating": 2.5},
        {"rating": "3"},
        {"seconds": -1},
        {"after": -1},
        {"more": 1},
        {"pair": PAIRS[0].digest},
    ],
)
def test_a_rating_out_of_bounds_is_refused(page, tmp_path, wrong):
    state = page.join("P1")
    assert page.rate(state, 3, state["key"], **wrong).status_code == 422
    assert read_ratings(tmp_path) == []


def test_foreign_requests_are_refused(page, tmp_path):
    state = page.join("P1")
    good = {"after": 0, "pair": state["pair"], "rating": 3, "seconds": 1.0, "robot": False}
    key = state["key"]
    assert page.post("/api/rate", good, key, Origin="http://evil.example").status_code == 403
    assert page.post("/api/rate", good, key, Host="evil.example").status_code == 403
    assert page.post("/api/rate", good, key, **{"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert page.post("/api/rate", good, "guess").status_code == 403
    assert page.post("/api/rate", b"x" * (MAX_BODY + 1), key).status_code == 413
    assert page.post("/api/join", {"code": "../P1", "robot": False}).status_code == 422
    assert read_ratings(tmp_path) == []


def test_a_code_entered_again_continues_and_the_older_page_says_so(page):
    first = page.join("P1")
    page.rate(first, 3, first["key"])
    second = page.join("P1")
    assert second["place"] == 1
    old = page.get("/api/pair/0", first["key"])
    assert old.status_code == 403
    assert "no longer connected" in old.json()["problem"]


def test_a_new_server_continues_where_a_rater_stopped(page, tmp_path, story):
    state = page.join("P1")
    key = state["key"]
    for rating in (2, 3):
        state = page.rate(state, rating, key).json()
    page.store.close()
    again = Page(tmp_path, story)
    state = again.join("P1")
    assert (state["place"], state["after"], state["pairs"]) == (2, 2, 5)
    assert again.rate(state, 4, state["key"]).status_code == 200
    assert again.get("/api/pair/0", state["key"]).json()["rating"] == 2
    again.store.close()
    assert [one.place for one in read_ratings(tmp_path)] == [0, 1, 2]


def test_answers_of_a_driven_browser_are_marked(page, tmp_path):
    state = page.join("P1", robot=True)
    page.rate(state, 3, state["key"], robot=True)
    assert read_ratings(tmp_path)[0].robot


def test_a_full_disk_says_so_and_changes_nothing(page, tmp_path, monkeypatch):
    state = page.join("P1")

    def full(_):
        raise OSError("ratings.sqlite cannot be used: database or disk is full")

    with monkeypatch.context() as patched:
        patched.setattr(page.store, "add", full)
        answer = page.rate(state, 3, state["key"])
    assert answer.status_code == 507
    assert "the disk of the server is full" in answer.json()["problem"]
    assert page.rate(state, 3, state["key"]).status_code == 200
    assert len(read_ratings(tmp_path)) == 1


def test_a_rater_of_a_changed_plan_keeps_what_was_answered(page, tmp_path, story):
    state = page.join("P1")
    page.rate(state, 3, state["key"])
    changed = replace(PAIRS[4], key=KEYS[2], other=KEYS[1])
    panel = Panel(
        {key.digest: page.store for key in KEYS}, {p.digest: p for p in PAIRS}, lambda _: [changed, *PAIRS[1:4]]
    )
    _, rater = panel.join("P1")
    assert rater.pairs == (PAIRS[0], changed, *PAIRS[1:3])
    assert rater.answered == 1
