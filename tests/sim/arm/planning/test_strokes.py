import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Refused
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.planning.strokes import MARGIN, find_strokes
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.physics.section import section
from simple_shapes import box_fragment as box

X, Y, Z = np.eye(3)
TOOL = knife(Settings())
MAX_TILT = np.radians(35.0)


def strokes(now, meant, plane):
    return find_strokes(now, meant, plane, TOOL, MAX_TILT)


def test_the_blade_comes_down_in_the_plane_and_ends_with_its_level_edge_on_the_board(lump, rng):
    small = Mesh(0.5 * lump.vertices, lump.faces)
    for _ in range(20):
        fragment = Fragment(small, Pose(Rotation.random(rng=rng).as_matrix(), [0.02, 0.01, 0.035]))
        lean, heading = np.radians(rng.uniform(-34.0, 34.0)), rng.uniform(0.0, 2.0 * np.pi)
        n = [np.cos(lean) * np.cos(heading), np.cos(lean) * np.sin(heading), np.sin(lean)]
        plane = Plane.through(fragment.p_WC, n)
        found = strokes((fragment,), (0,), plane)
        flips = {int(np.sign(stroke.X_WB.rotation[:, 0] @ plane.normal)) for stroke in found}
        assert flips == {1, -1}
        for stroke in found:
            x, y, z = stroke.X_WB.rotation.T
            assert abs(x @ plane.normal) == pytest.approx(1.0)
            assert y[2] == pytest.approx(0.0, abs=1e-12)
            assert z[2] == pytest.approx(np.cos(lean))  # the steepest line of the plane
            assert plane.distances(stroke.X_WB.position[None])[0] == pytest.approx(0.0, abs=1e-12)
            assert stroke.X_WB.position[2] == pytest.approx(0.0, abs=1e-12)
            cut = stroke.X_WB.inverse().apply(section(fragment, plane).reshape(-1, 3))
            assert np.abs(cut[:, 1]).max() <= TOOL.length / 2.0 - MARGIN + 1e-12
            assert cut[:, 2].max() == pytest.approx(stroke.depth)
            top = fragment.X_WF.apply(small.vertices)[:, 2].max()
            assert stroke.X_WB.position[2] + stroke.length * z[2] > top  # it begins above everything


def test_a_plane_that_lies_too_flat_is_refused_with_its_lean():
    fragment = box((0.06, 0.04, 0.03), [0, 0, 0.015])
    lean = np.radians(50.0)
    result = strokes((fragment,), (0,), Plane.through(fragment.p_WC, [np.cos(lean), 0.0, np.sin(lean)]))
    assert isinstance(result, Refused)
    assert "too flat" in result.reason
    assert "50 degrees" in result.reason


def test_a_section_longer_or_higher_than_the_blade_is_refused():
    long, high = box((0.02, 0.25, 0.03), [0, 0, 0.015]), box((0.02, 0.02, 0.09), [0, 0, 0.045])
    result = strokes((long,), (0,), Plane(X, 0.0))
    assert isinstance(result, Refused)
    assert "too short: the section is 250 mm long, the blade 240 mm" in result.reason
    result = strokes((high,), (0,), Plane(X, 0.0))
    assert isinstance(result, Refused)
    assert "too low: the section is 90 mm high, the blade 80 mm" in result.reason


def test_one_neighbour_is_avoided_and_two_neighbours_are_named_in_the_refusal():
    size = (0.03, 0.03, 0.03)
    middle, left, right = box(size, [0, 0, 0.015]), box(size, [0, -0.05, 0.015]), box(size, [0, 0.05, 0.015])
    passing = strokes((middle, left), (0,), Plane(X, 0.0))
    assert not isinstance(passing, Refused)
    for stroke in passing:
        ends = stroke.X_WB.position[1] + np.array([-0.5, 0.5]) * TOOL.length
        assert ends.min() > -0.035 - 1e-3
        assert ends.min() < -0.015 < 0.015 < ends.max()
    result = strokes((right, middle, left), (1,), Plane(X, 0.0))
    assert isinstance(result, Refused)
    assert "a neighbour is in the blade's way: fragments 0, 2" in result.reason
    assert not isinstance(strokes((right, middle, left), (0, 1, 2), Plane(X, 0.0)), Refused)


def test_a_neighbour_that_the_plane_barely_touches_is_not_in_the_way():
    size = (0.03, 0.06, 0.03)
    middle = box(size, [0, 0, 0.015])
    for gap, free in ((0.4e-3, True), (0.8e-3, False)):
        near = box((0.03, 0.3, 0.03), [0.03 - gap, 0.0, 0.015])
        found = strokes((middle, near), (0,), Plane(X, -0.015 + 1e-6))
        assert isinstance(found, Refused) is not free
