"""A robot's motions and what the cameras saw are recorded compactly over time."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

import recordings
from cutgrammar.events import CutMade
from cutgrammar.interfaces import Sighted
from cutgrammar_dashboards.recording.arm import RATE, peaks, thinned
from cutgrammar_dashboards.recording.arm_parts import held, moving, part_paths, part_tree, seen_from

rows = partial(recordings.rows, timeline="time")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, arm_story):
    return recordings.record(tmp_path_factory.mktemp("arm") / "trial.rrd", *arm_story)


@pytest.fixture
def motions(arm_story):
    return [event.motion for event in arm_story[2] if isinstance(event, CutMade)]


def path_of(recorded, name):
    """The path of a part, which tells which parts it moves with."""
    (path,) = {chunk.entity_path for chunk in RrdReader(str(recorded)).stream() if chunk.entity_path.endswith(name)}
    return path


def placed(recorded, path, seconds):
    """(4, 4) pose in the world of a part at a time, from the poses relative to its parents."""
    above = path.rpartition("/")[0]
    X = np.eye(4)
    for what in ("translation", "quaternion"):
        known = [v[0] for t, _, v in rows(recorded, path, f"Transform3D:{what}") if t <= seconds + 1e-6]
        if what == "translation":
            X[:3, 3] = known[-1]
        else:
            X[:3, :3] = Rotation.from_quat(known[-1]).as_matrix()
    return X if above == "/arm" else placed(recorded, above, seconds) @ X


def test_parts_of_the_arm_are_written_once_and_then_only_poses_that_change(recorded, motions):
    for name in ("base", "upper_arm", "forearm", "knife", "handle"):
        assert len(rows(recorded, path_of(recorded, f"/{name}"), "Mesh3D:vertex_positions")) == 1
    assert len(rows(recorded, "/arm/base", "Transform3D:translation")) == 1  # it stands still
    handle = rows(recorded, path_of(recorded, "/handle"), "Transform3D:quaternion")
    assert len(handle) == 1  # it does not move relative to the knife
    turns = rows(recorded, path_of(recorded, "/upper_arm"), "Transform3D:quaternion")
    seconds = sum(motion.times[-1] for motion in motions)
    assert 0.3 * RATE * seconds < len(turns) < RATE * seconds + 3 * len(motions)


def test_the_arm_has_the_poses_of_the_motion_at_every_time(recorded, motions):
    made = [t for t, _, v in rows(recorded, "/motion/phase", "TextDocument:text") if "is made" in v[0]]
    knife = path_of(recorded, "/knife")
    for ended, motion in zip(made, motions, strict=True):
        began = ended - motion.times[-1]
        kept = motion.times[thinned(motion.times)]
        for now in (kept[0], kept[len(kept) // 3], kept[-1]):
            at = int(np.searchsorted(motion.times, now - 1e-9))
            X = placed(recorded, knife, began + now)
            assert np.allclose(X[:3, 3], motion.poses[at, 3, :3], atol=1e-5)
            turn = Rotation.from_quat(motion.poses[at, 3, 3:], scalar_first=True).as_matrix()
            assert np.allclose(X[:3, :3], turn, atol=1e-5)


def test_a_part_is_placed_relative_to_the_one_with_which_it_moves(rng):
    turns = Rotation.from_euler("z", np.linspace(0, 1, 20)[:, None]).as_quat(scalar_first=True)
    still = np.tile([0, 0, 0, 1, 0, 0, 0.0], (20, 1))
    link = np.hstack([np.zeros((20, 3)), turns])
    tool = link.copy()
    tool[:, :3] = Rotation.from_quat(turns, scalar_first=True).apply([0.3, 0, 0])
    free = np.hstack([rng.normal(size=(20, 3)), Rotation.random(20, random_state=0).as_quat(scalar_first=True)])
    poses = np.stack([still, link, tool, free], axis=1)
    parents = part_tree(poses)
    assert parents[2] == 1
    assert part_paths(["base", "link 1", "tool", "free"], parents)[2].endswith("link_1/tool")
    assert np.allclose(seen_from(tool, link), [0.3, 0, 0, 1, 0, 0, 0])


def test_a_relative_pose_is_that_of_matrices(rng):
    turns = Rotation.random(60, random_state=1)
    poses = np.hstack([rng.normal(size=(60, 3)), turns.as_quat(scalar_first=True)])
    frames, bodies = poses[:30], poses[30:]
    back = turns[:30].inv()
    expected = np.hstack(
        [
            back.apply(bodies[:, :3] - frames[:, :3]),
            (back * turns[30:]).as_quat(scalar_first=True, canonical=True),
        ]
    )
    assert np.allclose(seen_from(bodies, frames), expected, atol=1e-12)


def test_time_continues_from_cut_to_cut(recorded, motions):
    texts = rows(recorded, "/log", "TextLog:text")
    times = [t for t, _, _ in texts]
    assert times == sorted(times)
    made = [t for t, _, v in texts if " made: " in v[0]]
    assert made[-1] > sum(motion.times[-1] for motion in motions)


def test_a_fragment_moves_while_it_is_carried_and_keeps_its_name(recorded, arm_story):
    cut = arm_story[2][[isinstance(e, CutMade) for e in arm_story[2]].index(True) :]
    motion = next(e for e in cut if isinstance(e, CutMade) and e.step == 2).motion
    carry = next(phase for phase in motion.phases if phase.name == "carry")
    heights = [v[0][2] for _, step, v in rows(recorded, "/now/2", "Transform3D:translation") if step == 1]
    assert max(heights) == pytest.approx(carry.poses[:, -1, 2].max(), abs=1e-3)
    assert len(heights) > 6
    assert len(rows(recorded, "/now/2", "Mesh3D:vertex_positions")) == 1


def test_fragments_are_cut_when_the_blade_leaves_and_settle_in_their_true_poses(recorded, arm_story):
    cleared = [(t, s) for t, s, _ in rows(recorded, "/now/0", "Clear:is_recursive")]
    retreat = [t for t, s, v in rows(recorded, "/motion/phase", "TextDocument:text") if v[0] == "cut 1: **retreat**"]
    assert cleared == [(retreat[0], 1)]
    for name, fragment in zip((3, 5, 6), arm_story[2][-2].configuration[1:], strict=True):
        settled = rows(recorded, f"/now/{name}", "Transform3D:translation")[-1][2][0]
        assert np.allclose(settled, fragment.X_WF.position, atol=1e-6)


def test_loads_are_shares_of_the_limits_and_keep_their_peaks(recorded, motions):
    torques = np.array([v for _, _, v in rows(recorded, "/motion/torque", "Scalars:scalars")])
    velocities = np.array([v for _, _, v in rows(recorded, "/motion/velocity", "Scalars:scalars")])
    forces = np.array([v for _, _, v in rows(recorded, "/motion/blade_force", "Scalars:scalars")])
    assert torques.max() == max((np.abs(m.torques) / m.torque_limits).max() for m in motions)
    assert velocities.max() == max((np.abs(m.velocities) / m.velocity_limits).max() for m in motions)
    assert forces.max() == max(m.blade_force.max() for m in motions)
    assert torques.shape == velocities.shape == (len(forces), 2)


def test_every_phase_and_the_summary_of_the_cut_are_recorded(recorded, arm_story):
    said = [v[0] for _, _, v in rows(recorded, "/motion/phase", "TextDocument:text")]
    phases = [f"cut {e.step}: **{p.name}**" for e in arm_story[2] if isinstance(e, CutMade) for p in e.motion.phases]
    assert [text for text in said if "**" in text] == phases
    assert "cut 2 refused: would cut a neighbour" in said
    logged = [v[0] for _, _, v in rows(recorded, "/log", "TextLog:text")]
    assert sum(text.startswith("the arm: cut where it lay; plane off by 0.012 degrees") for text in logged) == 2
    assert sum("moved first (a neighbour lay in the blade's way): turned 40 degrees" in text for text in logged) == 1


def test_seen_points_are_grey_and_segmented_points_have_a_colour_for_each_fragment(recorded, arm_story):
    sights = [event for event in arm_story[2] if isinstance(event, Sighted)]
    seen = rows(recorded, "/sight/seen", "Points3D:positions")
    assert len(seen) == len(sights) == 3
    assert [len(points) for _, _, points in seen] == [4000] * 3
    for colours, sight in zip(rows(recorded, "/sight/segmented", "Points3D:colors"), sights, strict=True):
        assert len(set(colours[2])) == len(np.unique(sight.labels))
    assert {len(set(colours)) for *_, colours in rows(recorded, "/sight/seen", "Points3D:colors")} == {1}


def test_a_parse_tree_names_true_fragments_whatever_the_order_of_the_perceived_ones(tmp_path, arm_story):
    start, goal, events = arm_story
    turned = [
        dataclasses.replace(e, configuration=e.configuration[::-1]) if isinstance(e, Sighted) else e for e in events
    ]
    path = recordings.record(tmp_path / "turned.rrd", start, goal, turned)
    labels = [v for _, _, v in rows(path, "/tree", "GraphNodes:labels")][-1]
    named = [label.split(":")[0] for label in labels if "#" in label]
    assert sorted(label.removeprefix("cut ") for label in named) == ["#1", "#3", "#4"]
    assert named[0] == "cut #4"  # the fragment with the cut, wherever it is in the order


def test_the_file_is_small_and_reproducible_except_for_its_date(tmp_path, recorded, arm_story):
    again = recordings.record(tmp_path / "again.rrd", *arm_story)
    assert recorded.stat().st_size < 1e6
    for entity, component in (
        (path_of(recorded, "/upper_arm"), "Transform3D:quaternion"),
        ("/now/2", "Transform3D:quaternion"),
        ("/motion/torque", "Scalars:scalars"),
        ("/sight/segmented", "Points3D:colors"),
    ):
        assert rows(again, entity, component) == rows(recorded, entity, component)


def test_kept_samples_are_evenly_spaced_and_include_both_ends():
    times = np.arange(0.0, 2.0, 1 / 240)
    kept = thinned(times)
    assert kept[0] == 0
    assert kept[-1] == len(times) - 1
    assert set(np.diff(kept)[:-1]) == {240 / RATE}
    assert thinned(times[:1]).tolist() == [0]


def test_poses_of_a_slowly_moving_body_are_kept_and_those_of_one_at_rest_are_not():
    poses = np.zeros((100, 7))
    poses[:, 3] = 1.0
    assert moving(poses).tolist() == [0]
    assert moving(poses, poses[0]).tolist() == []
    poses[:, 0] = 3e-7 * np.arange(100)  # less than what counts as rest from one to the next, but not in sum
    kept = moving(poses)
    assert np.abs(np.diff(poses[kept, 0])).max() < 2e-6
    assert len(kept) > 20


def test_numbers_of_a_pose_stay_until_they_have_changed_by_more_than_rest():
    poses = np.zeros((50, 7))
    poses[:, 3] = 1.0
    poses[:, 0] = 3e-7 * np.arange(50)
    poses[:, 1] = np.arange(50)
    kept = held(poses)
    assert np.abs(kept - poses).max() <= 1e-6
    assert len(np.unique(kept[:, 0])) < 20
    assert np.array_equal(kept[:, 1:], poses[:, 1:])


def test_peaks_between_kept_samples_are_not_lost(rng):
    values = rng.uniform(size=(101, 3))
    kept = np.array([0, 10, 55, 100])
    assert np.array_equal(peaks(values, kept).max(axis=0), values.max(axis=0))
    assert np.array_equal(peaks(values, kept)[0], values[0])
    assert np.array_equal(peaks(values, kept)[2], values[11:56].max(axis=0))
    assert np.array_equal(peaks(values[:1], np.array([0])), values[:1])
