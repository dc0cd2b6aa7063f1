import numpy as np
import pytest

from cutgrammar.events import CutMade
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.interfaces import Refusal, Stuck
from cutgrammar.methods.halving import HalvePlanner
from cutgrammar.methods.peeling import PeelPlanner, box_overlap
from cutgrammar.seeds import stream
from cutgrammar.settings import TrialSettings
from cutgrammar.trials.built_in_scores import IOU_STRICT
from cutgrammar.trials.run_trial import run_trial
from cutgrammar_sim.worlds.bench import Bench
from simple_shapes import box_fragment

LOAF = box_fragment([0.04, 0.05, 0.12], [0.0, 0.0, 0.0], heading=0.5)


def boxes(*sizes):
    """Boxes that lie nowhere near the loaf."""
    return tuple(box_fragment(size, [1.0, 0.3 * i, 0.0], heading=i) for i, size in enumerate(sizes))


def reached(goal, start=(LOAF,), planner=None):
    events = run_trial(
        start, goal, planner or PeelPlanner(), Bench(1e-3), [], stream, TrialSettings(), scores=[IOU_STRICT]
    )
    return events[-1].scores["iou_strict"], sum(isinstance(event, CutMade) for event in events)


def test_slices_of_unequal_thickness_are_peeled_off_where_halving_fails():
    goal = boxes(*([0.04, 0.05, thickness] for thickness in (0.01, 0.02, 0.035, 0.055)))
    assert reached(goal)[0] == pytest.approx(1.0, abs=1e-6)
    assert reached(goal, planner=HalvePlanner())[0] < 0.8


def test_cubes_are_reached_by_halving_first():
    goal = boxes(*([0.02, 0.025, 0.03] for _ in range(16)))
    score, cuts = reached(goal)
    assert cuts == 15
    assert score == pytest.approx(1.0, abs=1e-6)


def test_a_finished_fragment_is_left_alone():
    finished = box_fragment([0.04, 0.2, 0.05], [0.0, 0.5, 0.0])  # the longest, and the largest
    goal = boxes([0.04, 0.05, 0.2], [0.04, 0.05, 0.03], [0.04, 0.05, 0.09])
    score, cuts = reached(goal, (finished, LOAF))
    assert (score, cuts) == (pytest.approx(1.0, abs=1e-6), 1)


def test_clouds_are_peeled_like_meshes():
    goal = boxes([0.04, 0.05, 0.03], [0.04, 0.05, 0.09])
    seen = tuple(Fragment(sample_surface(f.mesh, 4000), f.X_WF) for f in (LOAF, *goal))
    exact = PeelPlanner().next_cut((LOAF,), goal, [], stream(0)).plane_W
    perceived = PeelPlanner().next_cut(seen[:1], seen[1:], [], stream(0)).plane_W
    long_axis = LOAF.X_WF.rotation[:, 2]
    assert abs(exact.normal @ long_axis) == pytest.approx(1.0)
    assert abs(perceived.normal @ long_axis) == pytest.approx(1.0, abs=1e-3)
    assert abs(perceived.distances(LOAF.p_WC)) == pytest.approx(0.03, abs=2e-3)


def test_every_refusal_brings_another_plane_until_none_is_left():
    goal = boxes([0.04, 0.05, 0.03], [0.04, 0.05, 0.09])
    planner, refused = PeelPlanner(), []
    while not isinstance(cut := planner.next_cut((LOAF,), goal, refused, stream(0)), Stuck):
        refused.append(Refusal(cut, "no"))
    planes = np.array([refusal.cut.plane_W.to_vector() for refusal in refused])
    assert len(planes) > 8  # both ends, two goal fragments, and the positions of halving
    assert len(np.unique(planes.round(9), axis=0)) >= 4 + 3
    assert "were refused" in cut.reason


def test_there_is_nothing_to_peel_for_a_goal_with_as_many_fragments():
    assert isinstance(PeelPlanner().next_cut((LOAF,), boxes([0.1, 0.1, 0.1]), [], stream(0)), Stuck)


def test_the_overlap_of_boxes_is_that_of_their_intersection():
    assert box_overlap(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0])) == 1.0
    assert box_overlap(np.array([1.0, 1.0, 1.0]), np.array([2.0, 1.0, 0.5])) == pytest.approx(1 / 3)


def test_a_flat_cloud_is_refused_by_name():
    flat = Fragment(sample_surface(LOAF.mesh, 200), Pose.identity())
    points = flat.shape.points * [1.0, 1.0, 0.0]
    flat = Fragment(type(flat.shape)(points, flat.shape.normals), Pose.identity())
    with pytest.raises(ValueError, match="lie in a plane"):
        PeelPlanner().next_cut((flat,), boxes([0.1, 0.1, 0.1], [0.1, 0.1, 0.1]), [], stream(0))
