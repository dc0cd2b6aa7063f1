"""What survives when a server dies or its disk is full, and what the page's requests may do."""

import errno
import json
import os
import time

import numpy as np
import pytest
import trimesh
from fastapi.testclient import TestClient

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.storage.data_set import DataSet, merge
from cutgrammar.storage.manifest import Manifest
from cutgrammar.trials.scoring import score
from cutgrammar_dashboards.demonstrating import collection as collections
from cutgrammar_dashboards.demonstrating.app import demonstration_page
from cutgrammar_dashboards.demonstrating.collection import ABANDONED_SECONDS, UNTOUCHED_SECONDS, Collection
from cutgrammar_dashboards.demonstrating.journal import Journal, read_journal
from cutgrammar_dashboards.demonstrating.task import Task, task_of

EYE = [0.0, -1.0, 0.5]


def task(trial, length=0.2):
    box = trimesh.creation.box((length, 0.04, 0.04))
    start = (Fragment(Mesh(box.vertices, box.faces), Pose(np.eye(3), np.array([0.0, 0.0, 0.02]))),)
    return Task(trial, "N1M1", ("slices",), ("block",), (("slices",),), start, 0)


def open_in(folder, total=3, make_task=task, clock=time.time):
    return Collection(folder, range(total), make_task, Manifest({}, 0, "by hand", {}, (), ()), clock)


class Person:
    """A browser's requests."""

    def __init__(self, collection, code="P1", robot=False):
        self.client = TestClient(demonstration_page(collection, {}), raise_server_exceptions=False)
        self.robot, self.seconds = robot, 0.0
        answer = self.client.post("/api/join", json={"code": code, "robot": robot}).json()
        self.key, self.after, self.joined = answer["key"], answer.get("after", 0), answer

    def post(self, path, **message):
        self.seconds += 1.0
        body = {"after": self.after, "seconds": self.seconds, "robot": self.robot} | message
        answer = self.client.post(path, json=body, headers={"X-Session": self.key})
        if answer.status_code == 200:
            self.after = answer.json().get("after", self.after)
        return answer

    def cut(self, x, path="/api/cut", **message):
        ends = np.array([[x, 0.05, 0.06], [x, -0.05, -0.02]]) - [x, -1.0, 0.5]
        stroke = {"eye": [x, -1.0, 0.5], "first": ends[0].tolist(), "second": ends[1].tolist(), "explode": 0.0}
        return self.post(path, **(stroke | {"first_seconds": 1.0, "second_seconds": 2.0} | message))


@pytest.fixture
def person(tmp_path):
    return Person(open_in(tmp_path))


def test_a_saved_demonstration_is_a_data_set_that_merges(person, tmp_path):
    for x in (0.0, 0.05, 0.08):
        assert person.cut(x).status_code == 200
    assert person.post("/api/undo").status_code == 200
    saved = person.post("/api/save")
    assert saved.json() == {"saved": 0, "progress": [1, 3]}
    data = DataSet.open(tmp_path)
    made = data.demonstration(0)
    assert made.demonstrator == "person P1"
    assert len(made.goal) == 3
    assert [cut.undone for cut in made.cuts] == [False, False, True]
    assert made.strokes[2].undone_seconds == 4.0
    merge([data, data], tmp_path / "both")
    both = DataSet.open(tmp_path / "both")
    assert both.demonstration(1).demonstrator == "person P1"
    assert both.demonstration(1).strokes[2].undone_seconds == 4.0
    assert np.array_equal(both.demonstration(1).strokes[0].first_W, made.strokes[0].first_W)


def test_a_preview_changes_nothing_and_shows_both_halves(person, tmp_path):
    answer = person.cut(0.03, "/api/preview").json()
    assert len(answer["above"]) == len(answer["below"]) == 1
    assert len(read_journal(tmp_path / "sessions" / "trial-00000.jsonl")) == 1


def test_people_at_once_have_tasks_of_their_own(tmp_path):
    collection = open_in(tmp_path)
    people = [Person(collection, code) for code in ("a", "b", "c", "d")]
    assert [p.joined["task"] and p.joined["task"]["trial"] for p in people] == [0, 1, 2, None]
    for p in reversed(people[:3]):
        p.cut(0.01)
        assert p.post("/api/save").status_code == 200
    assert [DataSet.open(tmp_path).demonstration(t).demonstrator for t in range(3)] == [
        "person a",
        "person b",
        "person c",
    ]


def test_an_abandoned_task_is_given_to_another_when_no_other_is_left(tmp_path):
    late = [0.0]
    collection = open_in(tmp_path, total=2, clock=lambda: time.time() + late[0])
    gone = Person(collection, "gone")
    gone.cut(0.0)
    late[0] = ABANDONED_SECONDS + 60.0
    second = Person(collection, "second")
    assert second.joined["task"]["trial"] == 1, "an abandoned task is not taken while another is left"
    third = Person(collection, "third")
    assert third.joined["task"]["trial"] == 0
    assert third.joined["cuts"] == 0
    for answer in (gone.cut(0.05), gone.post("/api/undo"), gone.post("/api/save")):
        assert answer.status_code == 403
        assert "given to somebody else" in answer.json()["problem"]
    third.cut(0.03)
    assert third.post("/api/save").status_code == 200
    assert DataSet.open(tmp_path).demonstration(0).demonstrator == "person third"
    kept = read_journal(tmp_path / "sessions" / "trial-00000-abandoned-1.jsonl")
    assert [entry["do"] for entry in kept] == ["start", "cut"]
    assert Person(open_in(tmp_path, total=2), "gone").joined["task"] is None


def test_tasks_that_were_opened_only_are_free_again_sooner(tmp_path):
    late = [0.0]
    collection = open_in(tmp_path, total=3, clock=lambda: time.time() + late[0])
    worker = Person(collection, "worker")
    worker.cut(0.0)
    idle = [Person(collection, name) for name in ("first", "second")]
    assert Person(collection, "early").joined["task"] is None
    late[0] = UNTOUCHED_SECONDS + 60.0
    assert [Person(collection, name).joined["task"]["trial"] for name in ("third", "fourth")] == [1, 2]
    assert Person(collection, "fifth").joined["task"] is None, "what somebody has cut in is kept for longer"
    assert [person.cut(0.05).status_code for person in idle] == [403, 403]
    assert worker.cut(0.05).status_code == 200


def test_who_returns_before_another_needs_the_task_continues(tmp_path):
    late = [0.0]
    collection = open_in(tmp_path, total=1, clock=lambda: time.time() + late[0])
    person = Person(collection)
    person.cut(0.0)
    late[0] = 2.0 * ABANDONED_SECONDS
    assert person.cut(0.05, "/api/preview").status_code == 200
    assert Person(collection, "P2").joined["task"] is None, "the preview shows that somebody is there"
    late[0] = 4.0 * ABANDONED_SECONDS
    assert Person(collection).joined["cuts"] == 1


def test_the_time_without_action_goes_on_while_the_server_is_down(person, tmp_path):
    person.cut(0.0)
    file = tmp_path / "sessions" / "trial-00000.jsonl"
    assert Person(open_in(tmp_path, total=1), "P2").joined["task"] is None
    long_ago = time.time() - ABANDONED_SECONDS - 60.0
    os.utime(file, (long_ago, long_ago))
    assert Person(open_in(tmp_path, total=1), "P2").joined["task"]["trial"] == 0


def test_a_finished_task_that_the_data_set_lacks_is_never_abandoned(person, tmp_path, monkeypatch):
    person.cut(0.0)
    late = [0.0]
    collection = open_in(tmp_path, total=1, clock=lambda: time.time() + late[0])
    again = Person(collection)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(collections, "add_trial", full)
    assert again.post("/api/save").status_code == 507
    monkeypatch.undo()
    late[0] = 2.0 * ABANDONED_SECONDS
    assert Person(collection, "P2").joined["task"] is None
    assert again.post("/api/save").status_code == 200


def test_an_open_demonstration_resumes_at_its_last_cut(person, tmp_path):
    person.cut(0.0)
    person.cut(0.05)
    again = Person(open_in(tmp_path))
    assert again.joined["cuts"] == 2
    assert again.joined["seconds"] == person.seconds
    assert len(again.joined["alive"]) == 3
    assert again.joined["after"] == person.after
    assert again.joined["new"] == person.client.get("/api/state", headers={"X-Session": person.key}).json()["new"]


def test_a_torn_tail_of_the_journal_is_ignored_and_overwritten(person, tmp_path):
    person.cut(0.0)
    file = tmp_path / "sessions" / "trial-00000.jsonl"
    whole = file.read_bytes()
    person.cut(0.05)
    longer = file.read_bytes()
    for end in (len(whole) + 1, (len(whole) + len(longer)) // 2, len(longer) - 1):
        file.write_bytes(longer[:end])
        again = Person(open_in(tmp_path))
        assert again.joined["cuts"] == 1
        assert again.cut(0.07).status_code == 200
        assert len(read_journal(file)) == 3
        assert Person(open_in(tmp_path)).joined["cuts"] == 2


def test_a_damaged_line_ends_the_journal(tmp_path):
    journal = Journal(tmp_path / "j")
    for number in range(3):
        journal.append({"n": number})
    content = bytearray((tmp_path / "j").read_bytes())
    content[content.index(b'"n": 1') + 5] = ord("7")
    (tmp_path / "j").write_bytes(content)
    assert read_journal(tmp_path / "j") == [{"n": 0}]


@pytest.mark.parametrize("written", [0, 1, 2, 3])
def test_a_server_that_died_during_a_save_completes_it(person, tmp_path, monkeypatch, written):
    """It dies after the journal says saved, and before, between or after the tables are written."""
    person.cut(0.0)
    person.cut(0.05)

    def die(*arguments):
        if written == 3:
            add(*arguments)
        elif written:
            monkeypatch.setattr(Manifest, "write", lambda self, folder: (_ for _ in ()).throw(SystemError("killed")))
            if written == 1:
                monkeypatch.setattr(
                    "cutgrammar.storage.data_set.write_part", lambda *_: (_ for _ in ()).throw(SystemError("killed"))
                )
            add(*arguments)
        raise SystemError("killed")

    add = collections.add_trial
    monkeypatch.setattr(collections, "add_trial", die)
    assert person.post("/api/save").status_code == 500
    monkeypatch.undo()
    collection = open_in(tmp_path)
    assert collection.progress == (1, 3)
    assert len(DataSet.open(tmp_path).demonstration(0).goal) == 3
    assert Person(collection).joined["task"]["trial"] == 1


def test_a_full_disk_is_told_and_changes_nothing(person, tmp_path, monkeypatch):
    person.cut(0.0)
    file = tmp_path / "sessions" / "trial-00000.jsonl"
    before = file.read_bytes()

    def full(descriptor, line, offset):
        write(descriptor, line[: len(line) // 2], offset)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    write = os.pwrite
    monkeypatch.setattr(os, "pwrite", full)
    for answer in (person.cut(0.05), person.post("/api/save"), person.post("/api/undo")):
        assert answer.status_code == 507
        assert "the disk of the server is full" in answer.json()["problem"]
        assert "kept" in answer.json()["problem"]
    assert file.read_bytes() == before
    monkeypatch.undo()
    assert person.cut(0.05).status_code == 200
    assert person.post("/api/save").status_code == 200


def test_a_disk_that_fills_up_during_a_save_leaves_the_data_set_whole(person, tmp_path, monkeypatch):
    person.cut(0.0)
    person.post("/api/save")
    second = Person(open_in(tmp_path))
    second.cut(0.02)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Manifest, "write", full)
    assert second.post("/api/save").status_code == 507
    assert [trial.trial for trial in DataSet.open(tmp_path).trials] == [0]
    monkeypatch.undo()
    assert second.post("/api/save").json()["progress"] == [2, 3]
    assert [trial.trial for trial in DataSet.open(tmp_path).trials] == [0, 1]


def test_a_replayed_cut_or_save_is_refused(person, tmp_path):
    assert person.cut(0.0).status_code == 200
    assert person.cut(0.05, after=1).status_code == 409
    assert person.post("/api/save").status_code == 200
    again = person.post("/api/save")
    assert again.status_code == 409
    assert "saved already" in again.json()["problem"]
    assert person.cut(0.05).status_code == 409
    assert len(DataSet.open(tmp_path).demonstration(0).goal) == 2


def test_an_unknown_key_and_one_that_was_replaced_are_refused(person, tmp_path):
    key, person.key = person.key, "guess"
    assert person.cut(0.0).status_code == 403
    person.key = key
    assert person.client.post("/api/join", json={"code": "P1", "robot": False}).json()["key"] != key
    assert person.cut(0.0).status_code == 403


@pytest.mark.parametrize(
    "wrong",
    [
        {"eye": [0, 0]},
        {"eye": [0, 0, 1e9]},
        {"first": [0, 0, "NaN"]},
        {"first": [0.0, 0.0, 0.0]},
        {"explode": 2},
        {"seconds": -1},
        {"after": -1},
        {"more": 1},
        {"robot": "perhaps"},
    ],
)
def test_requests_out_of_bounds_are_refused(person, wrong):
    assert person.cut(0.0, **wrong).status_code == 422
    assert person.cut(0.0).status_code == 200


@pytest.mark.parametrize("code", ["", "../../etc", "a b", "x" * 33, "<script>"])
def test_a_code_is_letters_digits_and_hyphens(person, code):
    assert person.client.post("/api/join", json={"code": code, "robot": False}).status_code == 422


def test_nothing_whole_can_be_saved(person):
    answer = person.post("/api/save")
    assert answer.status_code == 422
    assert "Still whole: block" in answer.json()["problem"]


def test_one_action_of_a_robot_makes_a_demonstration_a_robots(person, tmp_path):
    person.cut(0.0)
    person.cut(0.05, robot=True)
    person.post("/api/save")
    assert DataSet.open(tmp_path).demonstration(0).demonstrator == "test-robot P1"


def test_a_journal_of_other_objects_is_refused(person, tmp_path):
    person.cut(0.0)
    with pytest.raises(InputError, match="other objects"):
        open_in(tmp_path, make_task=lambda trial: task(trial, 0.19))


def test_goals_to_reproduce_are_shown_and_trials_keep_their_numbers(person, tmp_path):
    person.cut(0.02)
    person.post("/api/save")
    shown = DataSet.open(tmp_path).demonstration(0)
    (tmp_path / "again").mkdir()
    again = Collection(tmp_path / "again", [0], lambda _: task_of(shown), Manifest({}, 0, "by hand", {}, (), ()))
    second = Person(again, "P2")
    assert second.joined["task"]["instructions"] == ["Cut the block into the fragments of the goal, 2 in all."]
    assert second.joined["task"]["categories"] == []
    assert len(second.joined["goal"]["new"]) == len(second.joined["goal"]["shifts"]) == 2
    assert person.joined["goal"] is None
    second.cut(0.02)
    second.post("/api/save")
    made = DataSet.open(tmp_path / "again").demonstration(0)
    assert score(made.goal, shown.goal).scores["iou_strict"] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("name", ["\u202e", "\x1b[2J", "\ud800"])
def test_the_answer_to_an_unknown_field_has_no_control_characters(person, name):
    content = json.dumps({"after": 1, "seconds": 1.0, "robot": False, name: 1})  # escaped, as a browser sends it
    headers = {"X-Session": person.key, "Content-Type": "application/json"}
    answer = person.client.post("/api/undo", content=content, headers=headers)
    assert answer.status_code == 422
    assert "\u202e" not in answer.text
    assert "\x1b" not in answer.text
