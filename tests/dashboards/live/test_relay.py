"""A run is shown in a viewer while it works; slow: a real viewer shows two workers at once."""

import subprocess
import sys
import time
from functools import partial

import numpy as np
import pytest
import rerun as rr

import recordings
import viewers
from cutgrammar.events import CutMade, Planned
from cutgrammar.trials.news import RunBegan, TrainingAdvanced, TrainingBegan, TrialBegan, TrialEvent, TrialSaved
from cutgrammar_dashboards.live.connection import LOOK_SECONDS
from cutgrammar_dashboards.live.layout import STEP
from cutgrammar_dashboards.live.relay import Relay
from cutgrammar_dashboards.live.scoreboard import Scoreboard
from cutgrammar_dashboards.live.training import TrainingViews
from cutgrammar_dashboards.live.worlds import Worlds
from cutgrammar_dashboards.recording.viewer import free_port

rows = partial(recordings.rows, timeline="elapsed")
RUN = RunBegan("a run", 40, 2, arm=True, cameras=False, scored={"halve": (0.5, 0.7)})


@pytest.fixture
def stream():
    return rr.RecordingStream("cutgrammar")


@pytest.fixture
def shown(stream, tmp_path):
    """Saves what was sent to the stream, and returns the file."""

    def save():
        path = tmp_path / "shown.rrd"
        stream.save(path)
        stream.flush()
        stream.disconnect()
        return path

    return save


def play(worlds, worker, title, story, began=1.0):
    """Show a trial, an event a second."""
    start, goal, events = story
    worlds.begin(TrialBegan(worker, title, start, goal), began)
    for i, event in enumerate(events, start=1):
        worlds.show(TrialEvent(worker, title, event), began + i)


def test_every_worker_has_a_world_of_its_own(stream, shown, story, arm_story):
    worlds = Worlds(stream, 2)
    play(worlds, "host:1", "first", story)
    play(worlds, "host:2", "second", arm_story)
    path = shown()
    for place, title in (("/worker_1", "first"), ("/worker_2", "second")):
        said = [v[0] for _, _, v in rows(path, f"{place}/headline", "TextDocument:text")]
        assert all(text.startswith(f"**{title}**: ") for text in said)
        assert "strict IoU" in said[-1]
        assert rows(path, f"{place}/tree", "GraphNodes:labels")
        assert rows(path, f"{place}/now/6", "Mesh3D:vertex_positions")
    assert not rows(path, "/worker_1/arm/base", "Mesh3D:vertex_positions")
    assert len(rows(path, "/worker_2/arm/base", "Mesh3D:vertex_positions")) == 1


def test_the_search_and_the_motion_take_the_time_that_they_took(stream, shown, arm_story):
    play(Worlds(stream, 1), "a", "trial", arm_story, began=100.0)
    path = shown()
    events = arm_story[2]
    planned, made = (next(i for i, e in enumerate(events, 1) if isinstance(e, kind)) for kind in (Planned, CutMade))
    search = [t for t, _, _ in rows(path, "/worker_1/score/best_so_far", "Scalars:scalars")]
    assert min(search) >= 100.0 + planned - 1
    assert max(search[:60]) <= 100.0 + planned
    loads = [t for t, _, _ in rows(path, "/worker_1/motion/blade_force", "Scalars:scalars")]
    assert 100.0 + made - 1 < loads[0] < loads[1] < 100.0 + made


def test_the_next_trial_of_a_worker_replaces_the_one_before_but_the_arm_stays(stream, shown, arm_story):
    worlds = Worlds(stream, 1)
    play(worlds, "a", "first", arm_story, began=1.0)
    play(worlds, "a", "second", arm_story, began=50.0)
    path = shown()
    cleared = [t for t, _, _ in rows(path, "/worker_1/now", "Clear:is_recursive")]
    assert cleared == [1.0, 50.0]
    assert len(rows(path, "/worker_1/arm/base", "Mesh3D:vertex_positions")) == 1
    assert len(rows(path, "/worker_1/now/0", "Mesh3D:vertex_positions")) == 2
    # The viewer drops poses that are logged at the very time of a clear, so that all fragments would lie at the origin.
    for entity in ("/worker_1/now/0", "/worker_1/goal/2"):
        assert not set(cleared) & {t for t, _, _ in rows(path, entity, "Transform3D:translation")}


def test_events_of_a_trial_whose_beginning_was_lost_are_left_out(stream, shown, story):
    worlds = Worlds(stream, 1)
    start, goal, events = story
    worlds.begin(TrialBegan("a", "first", start, goal), 1.0)
    for event in events:
        worlds.show(TrialEvent("a", "second", event), 2.0)
    assert len(rows(shown(), "/worker_1/headline", "TextDocument:text")) == 1


def test_an_event_that_was_lost_is_made_up_for_by_the_next(stream, shown, story):
    worlds = Worlds(stream, 1)
    start, goal, events = story
    play(worlds, "a", "trial", (start, goal, [e for e in events if not (isinstance(e, CutMade) and e.step == 2)]))
    said = rows(shown(), "/worker_1/headline", "TextDocument:text")[-1][2][0]
    assert "4 fragments of 4" in said


def test_a_worker_that_died_gives_its_place_to_the_one_that_replaces_it(stream, shown, story):
    worlds = Worlds(stream, 1)
    play(worlds, "dead", "first", story, began=1.0)
    worlds.begin(TrialBegan("early", "second", *story[:2]), 20.0)
    worlds.begin(TrialBegan("new", "third", *story[:2]), 500.0)
    said = [v[0].split("*")[2] for _, _, v in rows(shown(), "/worker_1/headline", "TextDocument:text")]
    assert set(said) == {"first", "third"}


def test_the_scoreboard_counts_what_the_ledger_held_and_what_is_new(stream, shown):
    scores = Scoreboard(RUN)
    for news in (TrialSaved("t", "halve", "done", 0.9), TrialSaved("u", "grammar", "stuck", 0.8)):
        scores.add(news)
        scores.show(stream, 5.0, news)
    path = shown()
    table = rows(path, "/scores/table", "TextDocument:text")[-1][2][0]
    assert "4 of 40 trials" in table
    assert table.index("| grammar | 1 | 0.800 | 1 |") < table.index("| halve | 3 | 0.700 | 0 |")  # best first
    assert rows(path, "/scores/means/halve", "Scalars:scalars")[-1][2] == pytest.approx([0.7])


def test_curves_of_a_training_grow_and_those_of_folds_stand_beside_each_other(stream, shown):
    views = TrainingViews(stream, TrainingBegan("a model"))
    for epoch in (1, 2, 3):
        views.show(TrainingAdvanced("encoder", epoch, 3, ((epoch, 1.0 / epoch),)))
    for fold in (1, 2):
        views.show(TrainingAdvanced("planes", fold, 3, ((1, 2.0), (2, 1.5))))
    path = shown()
    losses = recordings.rows(path, "/curves/encoder/so_far", "Scalars:scalars", STEP)
    assert [(x, v) for x, _, v in losses] == [(1, [1.0]), (2, [0.5]), (3, [1.0 / 3])]
    assert len(recordings.rows(path, "/curves/planes/training_2", "Scalars:scalars", STEP)) == 2


def test_a_relay_without_a_viewer_takes_all_news_silently_and_ends(story, capfd):
    relay = Relay(f"rerun+http://127.0.0.1:{free_port()}/proxy")
    relay(RUN)
    relay(TrialBegan("a", "trial", *story[:2]))
    for event in story[2]:
        relay(TrialEvent("a", "trial", event))
    relay(TrialSaved("trial", "halve", "done", 0.5))
    relay.close()
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_viewer_shows_two_workers_at_once(viewer, story, arm_story):
    url, client = viewer
    relay = Relay(url, patient=True)
    relay(RUN)
    for worker, told in (("a", story), ("b", arm_story)):
        relay(TrialBegan(worker, f"trial of {worker}", *told[:2]))
        for event in told[2][:-1]:
            relay(TrialEvent(worker, f"trial of {worker}", event))
    relay(TrialSaved("trial of a", "halve", "done", 0.5))
    relay.close()
    wanted = {"Worker 1", "Worker 2", "Worker 2: fragments", "Arm", "Goal", "Parse tree", "Scores so far"}
    views = viewers.views_with(client, wanted)
    assert wanted <= {view.name for view in views}
    assert [report for view in views for report in view.reports] == []
    picture = client.take_screenshot()
    assert len(picture) > 20_000
    assert np.frombuffer(picture, dtype=np.uint8).std() > 1


@pytest.mark.slow
def test_a_viewer_that_is_started_later_is_shown_the_scores_and_the_trials_that_follow(tmp_path, story):
    port = free_port()
    relay = Relay(f"rerun+http://127.0.0.1:{port}/proxy")
    relay(RUN)
    relay(TrialBegan("a", "a trial that nobody saw", *story[:2]))
    with viewers.headless_viewer(tmp_path, port) as (_, client):
        time.sleep(LOOK_SECONDS)
        relay(TrialEvent("a", "a trial that nobody saw", story[2][0]))
        relay(TrialBegan("a", "the next trial", *story[:2]))
        for event in story[2]:
            relay(TrialEvent("a", "the next trial", event))
        relay.close()
        wanted = {"Worker 1", "Worker 1: fragments", "Goal", "Scores so far"}
        views = viewers.views_with(client, wanted)
    assert wanted <= {view.name for view in views}
    assert [report for view in views for report in view.reports] == []


CLOSED_AND_KILLED = """
import os, sys
from cutgrammar.trials.news import RunBegan
from cutgrammar_dashboards.live.relay import Relay

relay = Relay(sys.argv[1], patient=True)
relay(RunBegan("a run", 40, 2, arm=True, cameras=False, scored={}))
relay.close()
os.kill(os.getpid(), 9)
"""


@pytest.mark.slow
def test_the_end_of_a_run_is_no_error_in_the_viewer(tmp_path):
    with viewers.headless_viewer(tmp_path) as (url, client):
        assert subprocess.run([sys.executable, "-c", CLOSED_AND_KILLED, url], check=False).returncode == -9
        assert viewers.views_with(client, {"Scores so far"})
        time.sleep(2.0)
    assert "Error while receiving" not in (tmp_path / "viewer.log").read_text()
