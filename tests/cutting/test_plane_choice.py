"""Of many planes the one is chosen whose products become what the goal wants."""

import numpy as np
import pytest
import trimesh

from cutgrammar.cutting.plane_choice import PlaneWeights, Wanted, choose_plane
from cutgrammar.cutting.virtual_slicing import body_of
from cutgrammar.geometry.fragment import Mesh

WEIGHTS = PlaneWeights(fit=20.0, spread=0.5, adjust=False)
ACROSS = np.array([0.0, 0.0, 1.0])


def box(*sides):
    made = trimesh.creation.box(sides)
    return Mesh(made.vertices, made.faces)


BAR = body_of(box(0.02, 0.03, 0.10))
SLICE, REST = box(0.02, 0.03, 0.02), box(0.02, 0.03, 0.08)
AREA = 0.02 * 0.03


def plane_of(*arguments):
    return choose_plane(*arguments).numbers


def across(*heights):
    """Planes across the bar at these heights, in units of 5 cm."""
    return np.array([[*ACROSS, -height / 0.05] for height in heights])


def test_the_plane_that_leaves_the_goal_s_slice_is_chosen():
    wanted = [Wanted(AREA * 0.02, 1, body_of(SLICE)), Wanted(AREA * 0.08, 4)]
    plane = plane_of(BAR, wanted, across(-0.03, -0.01, 0.0, 0.002, 0.01), 0.05, WEIGHTS)
    np.testing.assert_allclose(plane, [*ACROSS, 0.03])


def test_either_child_may_lie_on_either_side():
    wanted = [Wanted(AREA * 0.08, 4), Wanted(AREA * 0.02, 1, body_of(SLICE))]
    plane = plane_of(BAR, wanted, across(0.03, -0.01, 0.0, 0.002), 0.05, WEIGHTS)
    np.testing.assert_allclose(plane, [*ACROSS, -0.03])


def test_where_only_volumes_are_known_the_volumes_decide():
    plane = plane_of(BAR, [Wanted(AREA * 0.06, 3), Wanted(AREA * 0.04, 2)], across(-0.03, 0.011, 0.03), 0.05,
                            WEIGHTS)  # fmt: skip
    np.testing.assert_allclose(plane, [*ACROSS, -0.011])


def test_an_adjusted_offset_makes_the_volumes_fit():
    adjusting = PlaneWeights(fit=20.0, spread=0.5, adjust=True)
    plane = plane_of(BAR, [Wanted(AREA * 0.06, 3), Wanted(AREA * 0.04, 2)], across(0.02), 0.05, adjusting)
    assert BAR.shares(plane[None])[0] == pytest.approx(0.4, abs=1e-4)
    np.testing.assert_allclose(plane, [*ACROSS, -0.01], atol=3e-4)


def test_of_planes_that_fit_alike_the_usual_one_is_chosen():
    unusual = np.array([[0.0, 1.0, 0.0, 0.0]])
    drawn = np.concatenate([unusual, across(0.0, 0.0005, -0.0005)])
    plane = plane_of(BAR, [Wanted(1.0, 2), Wanted(1.0, 2)], drawn, 0.05, WEIGHTS)
    np.testing.assert_allclose(plane[:3], ACROSS)


def test_the_spreads_of_a_type_decide_between_planes_of_equal_volumes():
    flat = np.append(np.log([0.01, 0.03, 0.10]) - np.log(12.0) / 2, 0.1)
    children = [Wanted(1.0, 2, log_spreads=flat), Wanted(1.0, 2, log_spreads=flat)]
    drawn = np.concatenate([np.array([[1.0, 0.0, 0.0, 0.0]]), across(0.0, 0.0, 0.0)])
    plane = plane_of(BAR, children, drawn, 0.05, WEIGHTS)
    np.testing.assert_allclose(np.abs(plane[:3]), [1.0, 0.0, 0.0])


def test_a_refused_plane_is_not_chosen_again():
    wanted = [Wanted(AREA * 0.02, 1, body_of(SLICE)), Wanted(AREA * 0.08, 4)]
    drawn = across(-0.03, 0.03, 0.03)
    first = plane_of(BAR, wanted, drawn, 0.05, WEIGHTS)
    refused = first[None] / np.array([1.0, 1.0, 1.0, 0.05])
    second = plane_of(BAR, wanted, drawn, 0.05, WEIGHTS, refused)
    assert first[3] == pytest.approx(-second[3])


def test_three_children_may_be_divided_two_to_one():
    wanted = [Wanted(AREA * 0.02, 1, body_of(SLICE)), Wanted(AREA * 0.04, 2), Wanted(AREA * 0.04, 2)]
    plane = plane_of(BAR, wanted, across(0.0, 0.03), 0.05, WEIGHTS)
    np.testing.assert_allclose(plane, [*ACROSS, -0.03])


def test_a_tilt_that_improves_the_fit_is_taken():
    tilted = np.array([[0.0, np.sin(0.2), np.cos(0.2), -0.6]])
    wanted = [Wanted(AREA * 0.02, 1, body_of(SLICE)), Wanted(AREA * 0.08, 1, body_of(REST))]
    for tilt, angle in ((False, 0.2), (True, 0.0)):
        weights = PlaneWeights(fit=60.0, spread=0.0, adjust=True, tilt=tilt)
        plane = plane_of(BAR, wanted, tilted, 0.05, weights)
        assert np.arccos(plane[2]) == pytest.approx(angle, abs=0.06)
