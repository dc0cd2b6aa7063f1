import dataclasses

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.comparison.overlap import Solid
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.trials.agreement import agrees, category_of
from cutgrammar.trials.scoring import score

FURTHER = ("iou_refined", "spectral", "agreement")


def cut_up(mesh, cuts, rng):
    found = [mesh]
    for _ in range(cuts):
        largest = max(range(len(found)), key=lambda i: found[i].volume)
        cut = slice_mesh(found[largest], Plane.through(found[largest].centroid, rng.normal(size=3)))
        found[largest : largest + 1] = cut.products
    return tuple(Fragment(piece, Pose.identity()) for piece in found)


def box(*size):
    shape = trimesh.creation.box(size)
    return Solid(Mesh(shape.vertices, shape.faces))


@pytest.fixture
def goal(lump, rng):
    return cut_up(lump, 5, rng)


@pytest.fixture
def reached(lump, rng):
    return cut_up(lump, 5, np.random.default_rng(5))


def test_a_copy_that_shares_nothing_but_the_shapes_scores_the_best(goal, rng, random_pose, remeshed):
    copy = [Fragment(remeshed(f.mesh, random_pose()), random_pose()) for f in goal]
    scored = score(tuple(copy[i] for i in rng.permutation(len(copy))), goal)
    assert scored.iou_strict == pytest.approx(1.0, abs=1e-9)
    assert scored.scores["iou_refined"] == pytest.approx(1.0, abs=1e-9)
    assert scored.scores["spectral"] == pytest.approx(0.0, abs=1e-7)
    assert scored.scores["agreement"] == 1.0


def test_pose_order_and_triangles_of_either_side_change_no_score(goal, reached, rng, random_pose, remeshed):
    expected = score(reached, goal)
    for _ in range(2):
        sides = []
        for side in (reached, goal):
            copy = [Fragment(remeshed(f.mesh, random_pose()), random_pose()) for f in side]
            sides.append(tuple(copy[i] for i in rng.permutation(len(copy))))
        other = score(*sides)
        assert other.scores["iou"] == pytest.approx(expected.scores["iou"], abs=1e-9)
        assert other.iou_strict == pytest.approx(expected.iou_strict, abs=1e-9)
        assert other.scores["iou_refined"] == pytest.approx(expected.scores["iou_refined"], abs=1e-4)
        assert other.scores["spectral"] == pytest.approx(expected.scores["spectral"], abs=1e-7)
        assert other.scores["agreement"] == expected.scores["agreement"]


def test_the_refined_score_is_at_least_the_strict_one(goal, reached):
    scored = score(reached, goal)
    assert scored.iou_strict < scored.scores["iou_refined"] <= 1.0


@pytest.mark.parametrize("kept", [1, 3, 5])
def test_stopping_early_with_perfect_fragments_loses_in_every_score(goal, kept):
    early, done = score(goal[:kept], goal), score(goal, goal)
    assert early.scores["iou"] == pytest.approx(1.0, abs=1e-9)
    assert early.iou_strict == pytest.approx(kept / 6, abs=1e-9)
    assert early.scores["iou_refined"] == pytest.approx(kept / 6, abs=1e-9)
    assert early.scores["agreement"] == pytest.approx(kept / 6, abs=1e-9)
    assert early.scores["spectral"] == pytest.approx(1 - kept / 6, abs=1e-9)
    assert done.scores["iou_refined"] > early.scores["iou_refined"]
    assert done.scores["spectral"] < early.scores["spectral"]


def test_cutting_more_fragments_than_the_goal_has_loses_too(goal):
    scored = score(goal, goal[:4])
    assert tuple(scored.scores[name] for name in FURTHER) == pytest.approx((4 / 6, 2 / 6, 4 / 6), abs=1e-9)


def test_scoring_twice_gives_the_same_bits(goal, reached):
    first = dataclasses.asdict(score(reached, goal))
    assert dataclasses.asdict(score(reached, goal)) == first
    copies = [tuple(Fragment(Mesh(f.mesh.vertices, f.mesh.faces), f.X_WF) for f in side) for side in (reached, goal)]
    assert dataclasses.asdict(score(*copies)) == first


def test_no_other_score_of_point_clouds_is_known(goal, reached):
    seen = tuple(Fragment(cloud_of(f.mesh, 64), f.X_WF) for f in goal)
    assert [score(reached, seen).scores[name] for name in FURTHER] == [None] * 3


def test_categories_are_read_off_sorted_extents():
    assert category_of(box(0.03, 0.03, 0.04)) == "compact"
    assert category_of(box(0.04, 0.01, 0.04)) == "slice"
    assert category_of(box(0.02, 0.02, 0.08)) == "strip"
    assert category_of(box(0.02, 0.035, 0.08)) == "strip"


def test_fragments_agree_in_category_and_in_volume_within_a_fifth():
    goal = box(0.02, 0.02, 0.08)
    assert agrees(box(0.02, 0.02, 0.095), goal)
    assert not agrees(box(0.02, 0.02, 0.097), goal)
    assert agrees(box(0.02, 0.02, 0.065), goal)
    assert not agrees(box(0.02, 0.02, 0.063), goal)
    assert not agrees(box(0.03, 0.03, 0.0355), goal)
