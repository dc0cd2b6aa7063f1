import dataclasses
import json

import numpy as np
import pytest

from cutgrammar.events import CutFailed, CutMade, CutRefused, GaveUp, Planned, Scored
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Explanation, TreeNode
from cutgrammar.trials.built_in_scores import COMPUTED
from cutgrammar.trials.record import Record, TrialKey, record_of, record_of_death

KEY = TrialKey("N1M1", 12, "in-place", "grammar", 0, "bench", "truth", "0" * 64)
WHY = Explanation((TreeNode(None, None),), "c0 -> c1 c1", -1.5, np.float64(-2.0), float("-inf"), (0.0,), 10, 3, True)
CUT = Cut(Plane([0, 0, 1], -0.25), np.array([[0.125, 0.0, 0.5]]), WHY)
SCORES = {"iou": 0.75, "iou_strict": 0.5, "iou_refined": 0.6, "spectral": 0.4, "agreement": 1 / 3}
SCORED = Scored(SCORES, 2, 3, ((0, 1, 0.7), (1, 0, 0.8)))


@pytest.fixture
def events(lump):
    fragment = Fragment(lump, Pose.identity())
    return [
        Planned(1, 0, CUT, 0.5),
        CutRefused(1, 0, "grazes"),
        Planned(1, 1, CUT, 0.25),
        CutMade(1, 2, (fragment, fragment)),
        GaveUp(2, "no idea"),
        SCORED,
    ]


def record(events, **changes):
    return record_of(KEY, events, **{"package": "0.1.0", "seconds": 2.0, **changes})


def test_a_record_counts_and_sums_what_happened(events):
    made = record(events)
    assert (made.status, made.reason) == ("stuck", "no idea")
    assert (made.cuts, made.refusals, made.dead_ends) == (1, 1, 2)
    assert (made.planning_seconds, made.seconds) == (0.75, 2.0)
    assert (made.scores, made.iou_strict, made.fragments, made.goal_fragments) == (SCORES, 0.5, 2, 3)


def test_events_are_kept_as_plain_data_without_meshes(events):
    data = record(events).events
    assert [event["event"] for event in data] == ["Planned", "CutRefused", "Planned", "CutMade", "GaveUp", "Scored"]
    assert data[0] == {
        "event": "Planned",
        "step": 1,
        "attempt": 0,
        "seconds": 0.5,
        "plane_W": [0.0, 0.0, 1.0, -0.25],
        "p_WC": [[0.125, 0.0, 0.5]],
        "production": "c0 -> c1 c1",
        "log_prior": -1.5,
        "log_shape": -2.0,
        "log_layout": None,
        "log_posterior": None,
        "rollouts": 10,
        "dead_ends": 3,
        "dead_end": True,
    }
    assert data[3] == {"event": "CutMade", "step": 1, "products": 2, "fragments": 2}
    assert data[5]["pairs"] == [[0, 1, 0.7], [1, 0, 0.8]]


def test_json_gives_the_same_record_again(events):
    made = record(events, render="vulkan")
    assert Record.from_json(json.loads(json.dumps(made.to_json(), allow_nan=False))) == made


def test_text_gives_the_same_record_again_also_with_names_that_nobody_knows(events):
    made = record(events)
    text = json.dumps(made.to_json()).encode()
    assert Record.from_text(text) == made
    assert Record.from_text(text).digest == made.digest
    added = Record.from_text(text.replace(b'"event": "GaveUp"', b'"event": "GaveUp", "mood": 1'))
    assert added.events[4] == {**made.events[4], "mood": 1}
    assert added.digest != made.digest


@pytest.mark.parametrize("number", ["1e999", "-Infinity", "NaN", "36893488147419103232", "9223372036854775808"])
@pytest.mark.parametrize("place", ['"rollouts": 10', '"mood": 10', '"goal_fragments": 3', '"predicted_iou": 10'])
def test_a_number_out_of_range_is_refused_wherever_it_stands(events, number, place):
    text = json.dumps(record(events).to_json())
    text = text.replace('"event": "Planned"', '"event": "Planned", "mood": 10, "predicted_iou": 10')
    with pytest.raises(ValueError, match=r"out of range|not a finite|64 bits|number|above|is wrong|expected"):
        Record.from_text(text.replace(place, f"{place.split()[0]} {number}").encode())


def test_the_digest_is_that_of_numbers_of_numpy_too(events):
    made = record(events)
    scores = {name: np.float64(value) for name, value in made.scores.items()}
    assert dataclasses.replace(made, scores=scores).digest == made.digest


def test_the_digest_covers_all_but_the_times(events):
    made = record(events)
    slower = [dataclasses.replace(e, seconds=9.0) if isinstance(e, Planned) else e for e in events]
    assert record(slower, seconds=30.0).digest == made.digest
    assert record([*events[:-1], dataclasses.replace(SCORED, scores=SCORES | {"iou": 0.76})]).digest != made.digest
    assert record(events, package="0.2.0").digest != made.digest
    assert dataclasses.replace(made, key=dataclasses.replace(KEY, run=1)).digest != made.digest


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(TrialKey)])
def test_every_part_of_a_key_changes_its_digest(field):
    other = 7 if isinstance(getattr(KEY, field), int) else "other"
    assert dataclasses.replace(KEY, **{field: other}).digest != KEY.digest


def test_the_status_says_how_a_trial_ended(events):
    assert record([SCORED]).status == "done"
    assert record([CutFailed(1, "slipped"), SCORED]).status == "failed"
    crashed = record(events, crash=("ValueError: x", "Traceback ..."))
    assert (crashed.status, crashed.reason, crashed.traceback) == ("crashed", "ValueError: x", "Traceback ...")
    assert crashed.iou_strict == 0.5


def test_a_flat_record_of_schema_1_is_read(events):
    made = record(events)
    flat = {name: value for name, value in made.to_json().items() if name != "scores"} | SCORES
    *others, last = flat["events"]
    flat["events"] = [*others, {name: value for name, value in last.items() if name != "scores"} | SCORES]
    assert Record.from_json(flat) == made
    assert Record.from_json(flat).digest == made.digest
    del flat["agreement"]
    assert Record.from_json(flat).scores == SCORES | {"agreement": None}


def test_a_trial_whose_process_died_has_the_worst_scores_and_no_matched_iou():
    dead = record_of_death(KEY, 5, package="0.1.0", reason="its process died 3 times", traceback="", scores=COMPUTED)
    assert (dead.status, dead.fragments) == ("crashed", None)
    worst = {"iou_strict": 0.0, "iou": None, "iou_refined": 0.0, "spectral": 1.0, "agreement": 0.0}
    assert dead.scores == worst
    assert dead.goal_fragments == 5
    assert Record.from_json(dead.to_json()) == dead


def test_a_record_with_an_unknown_status_is_refused(events):
    with pytest.raises(ValueError, match="status 'fine' is not one of done, stuck, failed, crashed"):
        Record.from_json(record(events).to_json() | {"status": "fine"})
