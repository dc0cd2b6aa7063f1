from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.events import Scored
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Cut
from cutgrammar.methods.method import Method
from cutgrammar.settings import Settings
from cutgrammar.storage.configurations import decode
from cutgrammar.trials.record import TrialKey
from cutgrammar.trials.scores import computed_scores
from cutgrammar_sim.worlds.bench import Bench
from cutgrammar_workers.trial_worker import EvaluationContext, Job, TrialWorker

SEEN = []
"""What the factories and planners below were given."""


class Slicer:
    """Cuts the largest fragment through its centroid, in a random direction; raises at a given cut."""

    def __init__(self, raise_at=None):
        self.raise_at = raise_at

    def next_cut(self, now, goal, refused, rng):
        if len(now) == self.raise_at:
            raise ZeroDivisionError("no idea")
        normal = rng.normal(size=3)
        SEEN.append(("goal", goal))
        SEEN.append(("normal", normal.tolist()))
        largest = max(now, key=lambda f: f.mesh.volume)
        return Cut(Plane.through(largest.p_WC, normal), largest.p_WC[None])


def plain(context):
    SEEN.append(("demonstration", context.demonstration))
    return Slicer()


def broken(context):
    raise RuntimeError("cannot be made")


PLAIN = Method("plain", plain)
OTHER = Method("other", lambda _: Slicer())
SEEING = Method("seeing", plain, sees_demonstration=True)
CRASHING = Method("crashing", lambda _: Slicer(raise_at=2))
BROKEN = Method("broken", broken)
METHODS = (PLAIN, OTHER, SEEING, CRASHING, BROKEN)


def make_world(settings, stream):
    SEEN.append(("noise", stream("camera", 3).integers(1 << 40)))
    return Bench(settings.world.min_share)


class Recorder:
    def __init__(self, path, title, start, goal):
        self.path, self.lines = Path(path), [title]

    def __call__(self, event):
        self.lines.append(type(event).__name__)

    def close(self):
        self.path.write_text("\n".join(self.lines))


class Deaf(Recorder):
    def __call__(self, event):
        raise OSError("no space left")


class Unclosed(Recorder):
    def close(self):
        raise OSError("no space left")


@pytest.fixture(autouse=True)
def forget():
    SEEN.clear()


@pytest.fixture
def demonstration(lump):
    """One object cut into three."""
    fragments = [DemonstratedFragment(0, None, 0, None, lump)]
    poses, cuts, X = {(0, 0): Pose.identity()}, [], Pose.identity()
    alive = [0]
    for step, normal in ((1, [1.0, 0, 0]), (2, [0, 1.0, 0])):
        cut = alive.pop(0)
        mesh = fragments[cut].mesh
        plane = Plane.through(mesh.centroid, normal)
        products = slice_mesh(mesh, plane).products
        ids = tuple(range(len(fragments), len(fragments) + len(products)))
        fragments += [DemonstratedFragment(i, cut, step, "chunks", p) for i, p in zip(ids, products, strict=True)]
        alive += ids
        cuts.append(DemonstratedCut(step, plane, plane.transformed(canonical_frame(mesh).inverse()), cut, ids))
        poses |= {(step, i): X for i in alive}
    return Demonstration(4, "N1M1", ("potato",), ("chunks",), "scripted", 0, tuple(fragments), poses, tuple(cuts))


def worker(record="none", **changes):
    return TrialWorker(
        EvaluationContext(
            **{
                "seed": 5,
                "settings": Settings(),
                "models": {"0": SimpleNamespace(digest="the model's")},
                "methods": {method.name: f"{__name__}:{method.name.upper()}" for method in METHODS},
                "world": f"{__name__}:make_world",
                "perception": "truth",
                "package": "0.1.0",
                "planners": 1,
                "record": record,
                "recorder": f"{__name__}:Recorder",
                "scores": computed_scores(),
            }
            | changes
        )
    )


def job(demonstration, method, goals="in-place", run=0):
    return Job(TrialKey("N1M1", 4, goals, method, run, "bench", "truth", "0"), demonstration)


def given(name):
    return [value for key, value in SEEN if key == name]


def test_a_job_becomes_a_record_of_its_key_and_model(demonstration):
    outcome = worker()(job(demonstration, "plain"))
    assert outcome.record.key == job(demonstration, "plain").key
    assert outcome.record.model == "the model's"
    assert (outcome.record.status, outcome.record.cuts, outcome.record.fragments) == ("done", 2, 3)
    assert 0.0 < outcome.record.iou_strict <= outcome.record.scores["iou"]
    assert outcome.recording is None


def test_only_a_method_that_declares_it_sees_the_demonstration(demonstration):
    do = worker()
    do(job(demonstration, "plain"))
    do(job(demonstration, "seeing"))
    assert given("demonstration") == [None, demonstration]


def test_methods_get_the_same_world_noise_and_goal_but_other_planner_streams(demonstration):
    do = worker()
    for method in ("plain", "other"):
        do(job(demonstration, method, "scattered"))
    assert len(set(given("noise"))) == 1
    goals = given("goal")
    assert all(np.array_equal(a.p_WC, b.p_WC) for a, b in zip(goals[0], goals[-1], strict=True))
    assert given("normal")[0] != given("normal")[2]


def test_runs_get_different_noise(demonstration):
    do = worker()
    do(job(demonstration, "plain", run=0))
    do(job(demonstration, "plain", run=1))
    assert len(set(given("noise"))) == 2
    assert given("normal")[0] != given("normal")[2]


def test_the_same_job_gives_the_same_record_whatever_was_done_before(demonstration):
    do = worker()
    first = do(job(demonstration, "plain")).record
    do(job(demonstration, "other"))
    assert do(job(demonstration, "plain")).record.digest == first.digest
    assert worker()(job(demonstration, "plain")).record.digest == first.digest


def test_a_crash_is_a_record_with_its_traceback_scored_by_what_was_reached(demonstration):
    record = worker()(job(demonstration, "crashing")).record
    assert (record.status, record.reason) == ("crashed", "ZeroDivisionError: no idea")
    assert 'raise ZeroDivisionError("no idea")' in record.traceback
    assert (record.cuts, record.fragments, record.goal_fragments) == (1, 2, 3)
    assert record.iou_strict == pytest.approx(record.scores["iou"] * 2 / 3)


def test_a_planner_that_cannot_be_made_is_a_crash_scored_by_the_start(demonstration):
    record = worker()(job(demonstration, "broken")).record
    assert (record.status, record.fragments) == ("crashed", 1)
    assert record.iou_strict > 0.0


def test_all_trials_or_those_that_failed_are_recorded(demonstration):
    recording = worker("all")(job(demonstration, "plain")).recording
    assert recording.decode().split("\n") == [
        "N1M1, trial 4, in-place, plain, run 0, bench",
        *["Planned", "CutMade"] * 2,
        "Scored",
    ]
    do = worker("failed")
    assert do(job(demonstration, "plain")).recording is None
    assert do(job(demonstration, "crashing")).recording.decode().split("\n")[1:] == ["Planned", "CutMade", "Scored"]


def test_a_recorder_changes_no_result(demonstration):
    assert (
        worker("all")(job(demonstration, "plain")).record.digest == worker()(job(demonstration, "plain")).record.digest
    )


@pytest.mark.parametrize("recorder", ["Deaf", "Unclosed"])
def test_a_recorder_that_fails_costs_the_recording_and_nothing_else(demonstration, recorder):
    outcome = worker("all", recorder=f"{__name__}:{recorder}")(job(demonstration, "plain"))
    assert outcome.record.digest == worker()(job(demonstration, "plain")).record.digest
    assert outcome.recording is None
    assert outcome.unrecorded == "OSError: no space left"


def test_a_reference_that_cannot_be_loaded_is_the_users_error():
    with pytest.raises(InputError, match="nowhere:make cannot be loaded"):
        worker(world="nowhere:make")


def test_the_last_event_is_the_score(demonstration):
    assert worker()(job(demonstration, "plain")).record.events[-1]["event"] == Scored.__name__


def test_scans_show_the_goal_as_closed_clouds_and_score_against_the_true_goal(demonstration):
    SEEN.clear()
    outcome = worker(perception="scans")(job(demonstration, "plain"))
    seen, true = given("goal")[0], demonstration.goal
    assert outcome.record.goal_fragments == len(seen) == len(true)
    by_volume = [sorted(f.mesh.volume for f in goal) for goal in (seen, true)]
    assert by_volume[0] == pytest.approx(by_volume[1], rel=0.05)
    assert by_volume[0] != by_volume[1]
    assert decode(outcome.configurations["goal"])[0].mesh.volume in [pytest.approx(v) for v in by_volume[1]]
