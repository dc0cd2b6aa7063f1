"""Export of joint trajectories: exact JSON, valid ROS YAML, and a message for every exceeded limit."""

import dataclasses
import json
import math

import numpy as np
import pytest
import yaml

from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, CutRefused, Planned, Scored
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut
from cutgrammar.motion import Execution
from cutgrammar.trials.trajectory import (
    FORMAT,
    MAX_POINTS,
    to_ros_yaml,
    trajectory_from_json,
    trajectory_of,
    trajectory_to_json,
)
from simple_shapes import box_fragment


def block(x):
    return box_fragment((0.04, 0.03, 0.02), [x, 0.0, 0.01])


def planned(step, attempt, x):
    return Planned(step, attempt, Cut(Plane.through(np.array([x, 0, 0]), np.array([1.0, 0, 0])), np.zeros((1, 3))), 0.1)


@pytest.fixture(scope="module")
def events(make_motion):
    one, two, three = (block(0.0),), (block(-0.02), block(0.02)), (block(-0.03), block(0.0), block(0.03))
    moved = Execution("out of reach", 90.0, 0.05, 0.01, 0.02, 5.0, 25.0, 0.6, 0.4, True)
    lay = Execution(None, 0.0, 0.0, 0.01, 0.02, 4.0, 25.0, 0.6, 0.4, True)
    return [
        planned(1, 0, 0.0),
        CutMade(1, 2, two, lay, make_motion(one, two, np.zeros(3), hertz=60)),
        planned(2, 0, 0.3),
        CutRefused(2, 0, "too flat"),
        planned(2, 1, 0.02),
        CutMade(2, 2, three, moved, make_motion(two, three, np.zeros(3), (1, np.array([0.02, 0, 0])), hertz=60)),
        Scored({"iou_strict": 1.0}, 3, 3, ()),
    ]


@pytest.fixture(scope="module")
def trajectory(events):
    return trajectory_of(events, "N1M1-0-in-place-grammar-0-kinova-truth", "Kinova Gen3")


def test_the_trajectory_contains_the_executed_motions(trajectory, events):
    motions = [event.motion for event in events if isinstance(event, CutMade)]
    assert [cut.step for cut in trajectory.cuts] == [1, 2]
    for cut, motion in zip(trajectory.cuts, motions, strict=True):
        assert np.array_equal(cut.positions, motion.positions)
        assert np.array_equal(cut.efforts, motion.torques)
        assert [name for name, _ in cut.phases] == [phase.name for phase in motion.phases]
    assert trajectory.cuts[1].why_moved == "out of reach"
    assert trajectory.cuts[1].plane_W.offset == pytest.approx(
        -0.02
    )  # that of the executed attempt, not of the refused one


def test_a_trial_without_a_motion_has_no_trajectory(events):
    still = [dataclasses.replace(e, motion=None) if isinstance(e, CutMade) else e for e in events]
    assert trajectory_of(still, "a", "b") is None
    assert trajectory_of(events[-1:], "a", "b") is None


def test_the_json_round_trip_is_exact(trajectory):
    again = trajectory_from_json(trajectory_to_json(trajectory))
    assert (again.trial, again.arm, again.joints) == (trajectory.trial, trajectory.arm, trajectory.joints)
    for name in ("positions", "velocities", "efforts"):
        assert np.array_equal(getattr(again.limits, name), getattr(trajectory.limits, name))
    for a, b in zip(again.cuts, trajectory.cuts, strict=True):
        for name in ("times", "positions", "velocities", "efforts", "p_WC"):
            assert np.array_equal(getattr(a, name), getattr(b, name))
        assert np.array_equal(a.plane_W.to_vector(), b.plane_W.to_vector())
        assert (a.step, a.phases) == (b.step, b.phases)
        assert (a.why_moved, a.turned_deg, a.carried) == (b.why_moved, b.turned_deg, b.carried)
    assert trajectory_to_json(again) == trajectory_to_json(trajectory)


def test_the_json_states_its_units_and_is_strict(trajectory):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    data = json.loads(trajectory_to_json(trajectory), parse_constant=refuse)
    assert data["format"] == FORMAT
    assert data["units"] == {
        "time": "s",
        "position": "rad",
        "velocity": "rad/s",
        "effort": "N m",
        "length": "m",
        "angle": "deg",
    }
    assert data["limits"]["positions"] == [[None, None], [-2.8, 2.8]]
    assert data["cuts"][0]["moved"] is None
    assert data["cuts"][1]["moved"] == {"why": "out of reach", "turned_deg": 90.0, "carried": 0.05}
    assert set(data["cuts"][0]["points"][0]) == {"time_from_start", "positions", "velocities", "efforts"}


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (lambda text: text[:-40], "is not JSON"),
        (lambda text: "[]", f"is not a {FORMAT}"),
        (lambda text: text.replace('"schema": 1', '"schema": 7'), "has schema 7"),
        (lambda text: text.replace('"step"', '"stop"'), "'step' is missing"),
        (lambda text: text.replace('"joints": ["shoulder", ', '"joints": ['), "is damaged"),
        (
            lambda text: text.replace('"time_from_start": 0.0, "pos', '"time_from_start": 9.0, "pos'),
            "are not ascending",
        ),
    ],
)
def test_a_damaged_file_is_refused_with_a_reason(trajectory, damage, text):
    with pytest.raises(InputError, match=text) as refused:
        trajectory_from_json(damage(trajectory_to_json(trajectory).decode()), "cuts.json")
    assert str(refused.value).startswith("cuts.json ")


def test_a_yaml_parser_reads_a_joint_trajectory_for_each_cut(trajectory):
    documents = list(yaml.safe_load_all(to_ros_yaml(trajectory)))
    assert len(documents) == 2
    for document, cut in zip(documents, trajectory.cuts, strict=True):
        assert list(document) == ["header", "joint_names", "points"]
        assert document["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        assert document["joint_names"] == ["shoulder", "elbow"]
        for name, rows in (
            ("positions", cut.positions),
            ("velocities", cut.velocities),
            ("accelerations", cut.accelerations),
        ):
            between = slice(None) if name == "positions" else slice(1, -1)
            assert np.array_equal(np.array([point[name] for point in document["points"]])[between], rows[between])
        times = [point["time_from_start"] for point in document["points"]]
        assert all(type(t["sec"]) is int and 0 <= t["nanosec"] < 10**9 for t in times)
        assert np.allclose([t["sec"] + 1e-9 * t["nanosec"] for t in times], cut.times, atol=1e-9)


def ends_at_rest(cut):
    """The cut with hardly any velocity at both ends, as a simulated arm has."""
    velocities = cut.velocities.copy()
    velocities[[0, -1]] = 1e-5
    return dataclasses.replace(cut, velocities=velocities)


def test_controllers_accept_the_yaml(trajectory):
    """The rules of ROS's joint_trajectory_controller and of Kinova's own server."""
    cut, n = trajectory.cuts[1], 5000
    rows = np.linspace(0, len(cut.times) - 1, n)
    dense = {
        name: np.stack([np.interp(rows, np.arange(len(cut.times)), q) for q in getattr(cut, name).T], axis=1)
        for name in ("positions", "velocities", "efforts")
    }
    dense["times"] = np.interp(rows, np.arange(len(cut.times)), cut.times)
    long = dataclasses.replace(trajectory, cuts=tuple(map(ends_at_rest, (cut, dataclasses.replace(cut, **dense)))))
    for document, whole in zip(yaml.safe_load_all(to_ros_yaml(long)), long.cuts, strict=True):
        points = document["points"]
        assert 2 <= len(points) <= MAX_POINTS
        assert all(set(point) == {"positions", "velocities", "accelerations", "time_from_start"} for point in points)
        for end in (points[0], points[-1]):
            assert end["velocities"] == end["accelerations"] == [0.0, 0.0]
        assert (points[0]["positions"], points[-1]["positions"]) == tuple(whole.positions[[0, -1]].tolist())
        times = [point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in points]
        assert np.diff(times).min() > 0
    assert len(points) > 0.9 * MAX_POINTS, "no more are left out than must be"


def test_a_motion_that_does_not_end_at_rest_is_not_told_to(trajectory):
    (cut, _) = trajectory.cuts
    moving = dataclasses.replace(cut, velocities=np.full_like(cut.velocities, 0.1))
    (document,) = yaml.safe_load_all(to_ros_yaml(dataclasses.replace(trajectory, cuts=(moving,))))
    assert document["points"][-1]["velocities"] == [0.1, 0.1]


@pytest.mark.parametrize("turns", [-2, -1, 1, 3])
def test_joints_without_end_stops_begin_within_half_a_turn_of_zero(events, trajectory, turns):
    """The first joint of the arm has no end stops, the second has."""
    shift = np.array([turns * math.tau, 0.0])
    away = [
        dataclasses.replace(e, motion=dataclasses.replace(e.motion, positions=e.motion.positions + shift))
        if isinstance(e, CutMade)
        else e
        for e in events
    ]
    again = trajectory_of(away, trajectory.trial, trajectory.arm)
    assert abs(again.cuts[0].positions[0, 0]) <= math.pi
    for cut, before in zip(again.cuts, trajectory.cuts, strict=True):
        np.testing.assert_allclose(cut.positions, before.positions, atol=1e-12)


@pytest.mark.parametrize("value", [0.0, -1e-5, 1e-05, 3.0, 1.5e-300, 1e22, -0.1, 123456789.125])
def test_any_yaml_parser_reads_numbers_as_numbers(trajectory, value):
    cut = trajectory.cuts[0]
    one = dataclasses.replace(cut, **{n: np.full((len(cut.times), 2), value) for n in ("positions", "velocities")})
    second = next(yaml.safe_load_all(to_ros_yaml(dataclasses.replace(trajectory, cuts=(one,)))))["points"][1]
    assert second["positions"] == second["velocities"] == [value, value]
    assert type(second["positions"][0]) is type(second["velocities"][0]) is float


def test_every_exceeded_limit_is_named_and_only_those(trajectory):
    assert trajectory.violations() == []
    cut = trajectory.cuts[1]
    positions, velocities, efforts = (np.array(x) for x in (cut.positions, cut.velocities, cut.efforts))
    positions[7, 1], positions[9, 0] = -3.0, 1000.0  # the shoulder is continuous
    velocities[3, 0] = -4.5
    efforts[5, 1], efforts[6, 1] = 21.0, 22.5
    broken = dataclasses.replace(cut, positions=positions, velocities=velocities, efforts=efforts)
    assert dataclasses.replace(trajectory, cuts=(trajectory.cuts[0], broken)).violations() == [
        "cut 2, elbow: position -3.0000 rad at 0.117 s is beyond its limit -2.8000 rad",
        "cut 2, shoulder: velocity -4.5000 rad/s at 0.050 s is beyond its limit -4.0000 rad/s",
        "cut 2, elbow: effort 22.5000 N m at 0.100 s is beyond its limit 20.0000 N m",
    ]


def test_thinning_keeps_the_ends_of_every_phase_and_the_path(trajectory):
    thin = trajectory.thinned(20.0)
    for full, cut in zip(trajectory.cuts, thin.cuts, strict=True):
        assert len(cut.times) < 0.6 * len(full.times)
        assert set(cut.times) <= set(full.times)
        assert {cut.times[0], cut.times[-1]} == {full.times[0], full.times[-1]}
        assert {begin for _, begin in cut.phases} <= set(cut.times)
        for j in range(2):
            again = np.interp(full.times, cut.times, cut.positions[:, j])
            assert np.abs(again - full.positions[:, j]).max() < 0.02


def test_a_higher_rate_than_the_motion_s_keeps_all_points(trajectory):
    assert trajectory_to_json(trajectory.thinned(1000.0)) == trajectory_to_json(trajectory)


def test_accelerations_are_the_derivatives_of_the_velocities(trajectory):
    cut = trajectory.cuts[0]
    moved = np.cumsum(0.5 * (cut.accelerations[1:] + cut.accelerations[:-1]) * np.diff(cut.times)[:, None], axis=0)
    assert np.allclose(moved, cut.velocities[1:] - cut.velocities[0], atol=0.12)
