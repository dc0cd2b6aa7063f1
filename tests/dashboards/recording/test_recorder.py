"""A recording contains the events of a trial; slow: it opens in a viewer without warnings."""

import itertools
import os
import socket
import subprocess
import sys
import time
from collections import Counter
from functools import partial

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

import recordings
from cutgrammar.events import CutFailed, GaveUp, Planned, Scored
from cutgrammar.geometry.fragment import Cloud, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.interfaces import Cut
from cutgrammar_dashboards.recording.recorder import Recorder
from cutgrammar_dashboards.recording.viewer import quiet_environment, viewer_binary
from cutgrammar_dashboards.rendering.placement import quad

rows = partial(recordings.rows, timeline="round")


def entities(path):
    return {chunk.entity_path for chunk in RrdReader(str(path)).stream()}


@pytest.fixture
def recorded(tmp_path, story):
    return recordings.record(tmp_path / "deep" / "trial.rrd", *story)


def test_every_mesh_is_written_once_and_then_only_poses_and_colours(recorded):
    counts = {
        e: len(rows(recorded, e, "Mesh3D:vertex_positions"))
        for e in entities(recorded)
        if e.startswith(("/now/", "/goal/"))
    }
    assert sorted(counts) == [*(f"/goal/{j}" for j in range(4)), *(f"/now/{i}" for i in range(7))]
    assert set(counts.values()) == {1}
    assert len(rows(recorded, "/now/1", "Transform3D:translation")) == 1
    colours = [v for _, _, v in rows(recorded, "/now/1", "Mesh3D:albedo_factor")]
    assert all(a != b for a, b in itertools.pairwise(colours))
    assert len(rows(recorded, "/goal/0", "Mesh3D:albedo_factor")) > 1


def test_a_fragment_is_cleared_when_it_is_cut(recorded):
    cleared = {name: [s for _, s, _ in rows(recorded, f"/now/{name}", "Clear:is_recursive")] for name in range(7)}
    assert cleared == {0: [1], 1: [], 2: [2], 3: [], 4: [3], 5: [], 6: []}


def test_the_log_lists_every_outcome_in_order(recorded):
    texts = [v[0] for _, _, v in rows(recorded, "/log", "TextLog:text")]
    levels = Counter(v[0] for _, _, v in rows(recorded, "/log", "TextLog:level"))
    assert [t.split(":")[0].split(",")[0] for t in texts] == [
        "N1M1",
        "cut 1",
        "cut 1 made",
        "cut 2",
        "cut 2 refused (attempt 1)",
        "cut 2",
        "cut 2 made",
        "cut 3",
        "cut 3 made",
        "scored",
    ]
    assert "would cut a neighbour" in texts[4]
    assert levels == {"INFO": 9, "WARN": 1}


def test_the_parse_tree_names_the_goal_fragments_its_terminals_are_grounded_to(recorded):
    trees = rows(recorded, "/tree", "GraphNodes:node_ids")
    assert [step for _, step, _ in trees] == [0, 1, 1, 2]
    labels = [v for _, _, v in rows(recorded, "/tree", "GraphNodes:labels")]
    colours = [v for _, _, v in rows(recorded, "/tree", "GraphNodes:colors")]
    for texts, shades in zip(labels, colours, strict=True):  # the production that the cut carries out stands out
        (divided,) = [i for i, text in enumerate(texts) if text.startswith("cut #")]
        assert [i for i, shade in enumerate(shades) if shade >> 8 == 0xFF5252] == [divided]
    assert {f"goal {j}" for j in range(4)} <= set(trees[0][2])
    assert len(rows(recorded, "/tree", "GraphNodes:positions")[0][2]) == len(trees[0][2])


def test_the_search_is_a_series_over_rounds(recorded, story):
    _, _, events = story
    series = rows(recorded, "/score/best_so_far", "Scalars:scalars")
    histories = [e.cut.explanation.history for e in events if isinstance(e, Planned)]
    assert [v[0] for _, _, v in series] == [value for history in histories for value in history]
    rounds = [r for r, _, _ in series]
    assert rounds == sorted(set(rounds))


def test_scores_and_pairs_are_recorded_at_the_end(recorded, story):
    scored = story[2][-1]
    assert rows(recorded, "/score/iou/strict", "Scalars:scalars")[0][2] == [scored.iou_strict]
    assert len(rows(recorded, "/matched/lines", "LineStrips3D:strips")[0][2]) == 4
    ((_, _, shift),) = rows(
        recorded, "/goal", "Transform3D:translation"
    )  # beside the result; no shape is written again
    assert shift[0][1] > 0.02
    assert not [entity for entity in entities(recorded) if entity.startswith("/matched/goal")]
    assert f"{scored.scores['iou']:.3f}" in rows(recorded, "/outcome", "TextDocument:text")[-1][2][0]


def test_the_blueprint_is_in_the_file(recorded):
    reader = RrdReader(str(recorded))
    assert [entry.application_id for entry in reader.recordings()] == ["cutgrammar"]
    assert len(reader.blueprints()) == 1


def test_the_same_trial_has_the_same_recording_id_and_the_same_rows(tmp_path, story):
    a, b = (recordings.record(tmp_path / f"{name}.rrd", *story) for name in "ab")
    assert RrdReader(str(a)).recordings() == RrdReader(str(b)).recordings()
    assert entities(a) - {"/__properties"} == entities(b) - {"/__properties"}
    assert rows(a, "/now/3", "Transform3D:quaternion") == rows(b, "/now/3", "Transform3D:quaternion")


def test_the_file_has_its_name_only_when_it_is_complete(tmp_path, story):
    start, goal, events = story
    path = tmp_path / "trial.rrd"
    recorder = Recorder(str(path), "a title", start, goal)
    recorder(events[0])
    assert not path.exists()
    recorder.close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["trial.rrd"]


def test_failed_trials_and_goals_that_are_clouds_are_recorded(tmp_path, story):
    start, goal, _ = story
    seen = tuple(Fragment(Cloud(c.points, c.normals), f.X_WF) for f in goal for c in [sample_surface(f.mesh, 300)])
    cut = Cut(Plane.through(start[0].p_WC, np.array([0, 0, 1.0])), start[0].p_WC[None])
    events = [
        Planned(1, 0, cut, 0.0),
        CutFailed(1, "the knife | slipped"),
        GaveUp(1, "refused too often"),
        Scored({"iou_strict": 0.0, "iou": None}, 0, 4, (), "clouds have no volume"),
    ]
    path = recordings.record(tmp_path / "bad.rrd", start, seen, events)
    texts = [v[0] for _, _, v in rows(path, "/log", "TextLog:text")]
    assert texts[-1] == "scored: strict IoU 0.000, matched IoU unknown (clouds have no volume), 0 pairs"
    assert not rows(path, "/score/iou/matched", "Scalars:scalars")
    assert len(rows(path, "/goal/0", "Points3D:positions")) == 1


def test_the_quad_is_in_the_plane_and_covers_the_fragment(story, rng):
    (fragment,), _, _ = story
    for _ in range(20):
        plane = Plane.through(fragment.p_WC + rng.normal(0, 0.005, 3), rng.normal(size=3))
        corners = quad(plane, [fragment])
        assert np.abs(plane.distances(corners)).max() < 1e-12
        u, v = corners[1] - corners[0], corners[3] - corners[0]
        assert abs(u @ v) < 1e-12
        inside = fragment.X_WF.apply(fragment.mesh.vertices) - corners[0]
        for side in (u, v):
            share = inside @ side / (side @ side)
            assert share.min() > 0.0
            assert share.max() < 1.0


def test_recording_uses_no_network_and_writes_nothing_in_the_home_folder(tmp_path):
    code = (
        "import socket\n"
        "def refuse(*a, **k): raise SystemExit('a socket was opened')\n"
        "socket.socket.connect = refuse\n"
        "from cutgrammar_dashboards.recording.recorder import Recorder\n"
        f"Recorder({str(tmp_path / 'x.rrd')!r}, 'x', (), ()).close()\n"
    )
    home = tmp_path / "home"
    home.mkdir()
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "HOME": str(home)}, timeout=120)
    assert list(home.rglob("*rerun*")) == []


ALWAYS = (
    "Current fragments",
    "Goal",
    "Matched pairs at the end",
    "Parse tree: terminals and the goal fragments they are grounded to",
    "Best score over the rounds of search",
    "Number of fragments",
    "What happened",
    "Outcome",
)
WITH_AN_ARM = (
    "The arm at work",
    "Seen by the cameras",
    "Segmented",
    "Torques, as shares of their limits",
    "Velocities, as shares of their limits",
    "Force on the blade [N]",
    "What the arm does",
)


@pytest.mark.slow
@pytest.mark.parametrize(("story_name", "more"), [("story", ()), ("arm_story", WITH_AN_ARM)])
def test_a_recording_opens_in_a_viewer_without_warnings(story_name, more, request, tmp_path):
    recorded = recordings.record(tmp_path / "trial.rrd", *request.getfixturevalue(story_name))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = tmp_path / "viewer.log"
    with log.open("w") as out:
        viewer = subprocess.Popen(
            [viewer_binary(), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", "1400x1000"],
            env=quiet_environment(),
            stdout=out,
            stderr=out,
        )
    try:
        client = opened(viewer, port, recorded, log)
        views = client.get_state().views
        assert sorted(view.name for view in views) == sorted([*ALWAYS, *more])
        assert [report for view in views for report in view.reports] == []
        client.set_time("round", sequence=62, play_state="paused")
        picture = client.take_screenshot()
        assert len(picture) > 20_000
    finally:
        viewer.terminate()
        viewer.wait(10)


def opened(viewer, port, path, log):
    """A client of the viewer that has the recording open; skips the test where nothing can draw."""
    for _ in range(60):
        if viewer.poll() is not None or "Failed to get render context" in log.read_text():
            pytest.skip("no graphics adapter that rerun can draw with on this machine")
        try:
            client = ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
            client.open(str(path))
            if client.get_state().views:
                time.sleep(1.0)
                return client
        except ConnectionError:
            pass
        time.sleep(0.5)
    raise AssertionError(f"the viewer did not open the recording:\n{log.read_text()}")
