"""The state of a demonstration made by hand, and what it leaves."""

import numpy as np
import pytest
import trimesh

from cutgrammar.demonstration import HandStroke
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed
from cutgrammar_dashboards.demonstrating.cutting_state import CuttingState, new_state
from cutgrammar_dashboards.demonstrating.strokes import plane_of, target_of
from cutgrammar_dashboards.demonstrating.task import Task

EYE = (0.0, -1.0, 0.5)


def bar(y):
    box = trimesh.creation.box((0.2, 0.04, 0.04))
    return Fragment(Mesh(box.vertices, box.faces), Pose(np.eye(3), np.array([0.0, y, 0.02])))


@pytest.fixture
def state():
    """Two bars along x, one behind the other; the first for chunks and cubes, the second for slices."""
    jobs = (("chunks", "cubes"), ("slices",))
    start = (bar(-0.1), bar(0.1))
    return new_state(Task(3, "N2M3", ("chunks", "slices", "cubes"), ("carrot", "carrot"), jobs, start, 7))


def stroke_between(first, second, explode=0.0, eye=EYE):
    directions = [np.subtract(point, eye) / np.linalg.norm(np.subtract(point, eye)) for point in (first, second)]
    return HandStroke(0, np.array(eye), *directions, explode, 1.0, 2.0, 3.0)


def across(x, y, height=0.0):
    """A stroke over the bar at y from its back to its front, at x."""
    return stroke_between((x, y + 0.05, 0.06 + height), (x, y - 0.05, -0.02 + height))


def cut(state, stroke):
    fragment, plane = target_of(state, stroke)
    after = state.cut(fragment, plane, stroke)
    assert isinstance(after, CuttingState)
    return after


def test_the_plane_contains_the_eye_and_both_clicks():
    stroke = stroke_between((0.1, 0.0, 0.0), (0.0, 0.2, 0.1))
    plane = plane_of(stroke)
    points = [stroke.p_WE, stroke.p_WE + stroke.first_W, stroke.p_WE + 3.0 * stroke.second_W]
    assert np.abs(plane.distances(np.array(points))).max() < 1e-12


def test_two_clicks_at_one_place_define_no_plane(state):
    stroke = stroke_between((0.0, 0.0, 0.0), (0.0005, 0.0, 0.0))
    assert isinstance(plane_of(stroke), Missed)
    assert "same place" in target_of(state, stroke).reason


def test_a_stroke_beside_everything_is_refused(state):
    assert "misses every fragment" in target_of(state, across(0.3, -0.1)).reason


@pytest.mark.parametrize(("y", "number"), [(-0.1, 0), (0.1, 1)])
def test_the_fragment_under_most_of_the_stroke_is_cut(state, y, number):
    fragment, plane = target_of(state, across(0.02, y))
    assert fragment == number
    assert abs(plane.normal[0]) > 0.99


def test_a_stroke_that_ends_on_a_nearer_neighbour_still_cuts_what_it_passes_over(state):
    stroke = stroke_between((0.05, 0.16, 0.03), (0.05, -0.083, 0.03))
    assert target_of(state, stroke)[0] == 1


def test_fragments_shown_apart_are_cut_where_they_are_seen(state):
    halved = cut(state, across(0.0, -0.1))
    right = max(halved.alive, key=lambda i: halved.fragment(i).p_WC[0])
    shift = halved.shifts()[right]
    assert shift[0] > 0.01
    seen = stroke_between(
        (0.05 + shift[0], -0.05, 0.06), (0.05 + shift[0], -0.15, -0.02), explode=1.0, eye=(0.05 + shift[0], -1.0, 0.5)
    )
    fragment, plane = target_of(halved, seen)
    assert fragment == right
    assert plane.distances(np.array([[0.05, -0.1, 0.02]]))[0] == pytest.approx(0.0, abs=1e-9)


def test_a_cut_keeps_all_volume_and_both_frames(state):
    after = cut(state, across(0.03, -0.1))
    made = after.cuts[0]
    whole = state.fragment(0)
    assert sum(after.fragment(i).mesh.volume for i in made.products) == pytest.approx(whole.mesh.volume)
    back = made.plane_C.transformed(whole.X_WF @ canonical_frame(whole.mesh))
    assert np.allclose(back.to_vector(), made.plane_W.to_vector())
    sides = [float(made.plane_W.distances(after.fragment(i).p_WC)) for i in made.products]
    assert sides[0] > 0.0 > sides[1]


def test_a_plane_that_grazes_is_refused(state):
    plane = Plane(np.array([1.0, 0.0, 0.0]), -0.09999)
    assert isinstance(state.cut(0, plane, across(0.0, 0.0)), Missed)


def test_undone_cuts_stay_in_the_record_and_are_ignored(state):
    once = cut(state, across(0.0, -0.1))
    twice = cut(once, across(0.05, -0.1))
    back = twice.undo(9.0)
    assert back.alive == once.alive
    again = cut(cut(back, across(-0.05, -0.1)), across(0.0, 0.1))
    made = again.demonstration("person P1")
    assert [c.undone for c in made.cuts] == [False, True, False, False]
    assert [c.step for c in made.cuts] == [1, 2, 4, 5]
    assert [s.step for s in made.strokes] == [1, 2, 4, 5]
    assert [s.undone_seconds for s in made.strokes] == [None, 9.0, None, None]
    assert made.alive(1) == made.alive(3)
    assert len(made.goal) == 5
    assert sum(f.mesh.volume for f in made.goal) == pytest.approx(sum(f.mesh.volume for f in made.start))
    assert set(made.alive(made.steps)) == set(again.alive)
    with pytest.raises(ValueError, match="no cut to undo"):
        state.undo(1.0)


def test_fragments_get_the_category_of_the_part_they_lie_in(state):
    made = cut(cut(state, across(0.0, -0.1)), across(0.0, 0.1)).demonstration("person P1")
    of = {i: made.fragments[i].category for i in made.alive(made.steps)}
    left, right = (
        pick((i for i in of if made.fragment_at(2, i).p_WC[1] < 0), key=lambda i: made.fragment_at(2, i).p_WC[0])
        for pick in (min, max)
    )
    assert (of[left], of[right]) == ("chunks", "cubes")
    assert sorted(of.values()) == ["chunks", "cubes", "slices", "slices"]
    assert made.fragments[0].category is None


def test_what_is_still_whole_is_named(state):
    assert state.unfinished() == ("carrot 1", "carrot 2")
    assert cut(state, across(0.0, 0.1)).unfinished() == ("carrot 1",)


def test_instructions_name_every_object_and_its_categories(state):
    assert state.task.instructions == (
        "Cut carrot 1: the left half into chunks and the right half into cubes.",
        "Cut carrot 2 into slices.",
    )
