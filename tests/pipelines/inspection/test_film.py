"""A trial is written as a film, key frames or both; wrong arguments are refused before any work."""

import numpy as np
import pytest
from PIL import Image

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.film.frames import FilmSettings
from cutgrammar_dashboards.film.stills import Still
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.config import FilmConfig
from cutgrammar_pipelines.inspection import film as filming
from cutgrammar_pipelines.inspection import trial_trace
from cutgrammar_pipelines.inspection.film import film

TRIAL = "N1M1-0-in-place-grammar-0-kinova-truth"


@pytest.fixture
def painted(monkeypatch):
    """Small frames replace rendered ones; yields the arguments with which they were requested."""
    requests = []

    def film_frames(start, goal, events, foods, settings, processes):
        assert processes >= 1
        requests.append((goal, tuple(foods), settings))
        for i in range(20):
            picture = np.zeros((24, 32, 3), dtype=np.uint8)
            picture[:, i : i + 8] = [255, 200, 90]  # a bar that moves
            yield picture

    monkeypatch.setattr(filming, "film_frames", film_frames)

    def small_stills(start, goal, events, foods, width, height):
        assert (width, height) in (filming.SMALL, filming.LARGE)
        return [
            Still(name, np.full((24, 32, 3), 77, dtype=np.uint8)) for name in ("initial", "cut 1", "result", "goal")
        ]

    monkeypatch.setattr(filming, "stills", small_stills)
    return requests


@pytest.mark.parametrize("name", ["a.webp", "a.gif", "a.png"])
def test_the_suffix_decides_the_format_of_the_film(arm_run, arm_events, carried_out, painted, tmp_path, name, capsys):
    carried_out(arm_events)
    assert main(["film", str(arm_run), TRIAL, "--out", str(tmp_path / "deep" / name), "--seconds", "5"]) == 0
    with Image.open(tmp_path / "deep" / name) as written:
        assert written.n_frames == 20
    assert [file.name for file in (tmp_path / "deep").iterdir()] == [name]
    ((goal, foods, settings),) = painted
    assert (foods, settings) == (("carrot",), FilmSettings(max_seconds=5.0))
    places = [fragment.p_WC[0] for fragment in goal]  # halves that touch are shown apart
    assert places == pytest.approx([1.3 * fragment.p_WC[0] for fragment in arm_events[1].configuration])
    out, err = capsys.readouterr()
    assert out.splitlines() == [str(tmp_path / "deep" / name)]
    assert "film: 20 of" in err


def test_only_stills_are_written_if_only_they_are_requested(
    arm_run, arm_events, carried_out, painted, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    carried_out(arm_events)
    for words, name in (([], f"{TRIAL}.png"), (["deep/keys.png"], "deep/keys.png")):
        assert main(["film", str(arm_run), TRIAL, "--stills", *words]) == 0
        with Image.open(name) as written:
            assert written.size == (64, 48)
            assert np.asarray(written.convert("RGB")).max() == 77
    assert main(["film", str(arm_run), TRIAL, "--stills", "apart"]) == 0
    names = ["1-initial.png", "2-cut-1.png", "3-result.png", "4-goal.png"]
    assert sorted(file.name for file in (tmp_path / "apart").iterdir()) == names
    assert painted == []
    assert list(tmp_path.glob("*.webp")) == []


def test_without_a_name_a_film_is_named_after_its_trial(
    arm_run, arm_events, carried_out, painted, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    carried_out(arm_events)
    film(FilmConfig(arm_run, "N1M1-0-in-place-grammar-0-k"))
    assert (tmp_path / f"{TRIAL}.webp").exists()


def test_an_interrupted_film_leaves_no_file(arm_run, arm_events, carried_out, painted, tmp_path, monkeypatch):
    def breaks(*_):
        yield np.zeros((24, 32, 3), dtype=np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(filming, "film_frames", breaks)
    carried_out(arm_events)
    assert main(["film", str(arm_run), TRIAL, "--out", str(tmp_path / "films" / "a.gif")]) == 130
    assert list((tmp_path / "films").iterdir()) == []


def test_wrong_suffixes_and_unknown_trials_are_refused_before_any_work(arm_run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(trial_trace, "worker_for", lambda *_: pytest.fail("a trial was carried out"))
    with pytest.raises(InputError, match=r"--out .*a\.mp4 cannot be written; .* ends in \.webp, \.gif, \.png"):
        film(FilmConfig(arm_run, TRIAL, out=tmp_path / "a.mp4"))
    with pytest.raises(InputError, match=r"--stills .*a\.gif cannot be written; .* ends in \.png, or of a folder"):
        film(FilmConfig(arm_run, TRIAL, stills=(tmp_path / "a.gif",)))
    assert main(["film", str(arm_run), TRIAL, "--stills", "a.png", "b.png"]) == 2
    assert "--stills takes one file or folder, not 2" in capsys.readouterr().err
    with pytest.raises(InputError, match="the closest name is"):
        film(FilmConfig(arm_run, "N9"))


def test_a_scattered_goal_is_shown_as_it_is(arm_events, halved):
    goal = arm_events[1].configuration
    elsewhere = tuple(Fragment(f.shape, Pose(np.eye(3), f.X_WF.position + 0.1 * np.eye(3)[1])) for f in goal)
    assert filming._spread_out(elsewhere, halved(goal)) is elsewhere


def test_a_foreign_goal_is_spread_about_the_objects_in_whose_place_it_lies(arm_events):
    goal = arm_events[1].configuration
    places = [Fragment(f.shape, Pose(np.eye(3), [0.3 * i, 0.0, 0.0])) for i, f in enumerate(goal)]
    beside = tuple(Fragment(f.shape, Pose(np.eye(3), f.X_WF.position + np.array([0.3, 0.0, 0.0]))) for f in goal)
    spread = filming._spread_over_start((*goal, *beside), tuple(places))
    assert len(spread) == 2 * len(goal)
    between = [np.linalg.norm(a.p_WC - b.p_WC) for a, b in ((spread[0], spread[1]), (goal[0], goal[1]))]
    assert between[0] > 1.2 * between[1]


@pytest.mark.slow
def test_the_arm_is_filmed(arm_run, arm_events, carried_out, tmp_path):
    carried_out(arm_events)
    assert film(FilmConfig(arm_run, TRIAL, out=tmp_path / "a.webp", stills=(tmp_path / "a.png",), seconds=1)) == 0
    with Image.open(tmp_path / "a.webp") as written:
        assert written.n_frames > 10  # pictures in which nothing moves count as one
        first = np.asarray(written.convert("RGB"), dtype=np.int64)
        written.seek(written.n_frames // 2)
        assert np.abs(np.asarray(written.convert("RGB"), dtype=np.int64) - first).max() > 60  # something has moved
    with Image.open(tmp_path / "a.png") as keys:
        assert keys.size == (1280, 2 * 480)
