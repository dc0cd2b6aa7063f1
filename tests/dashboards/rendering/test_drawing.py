"""Drawings have the right size and visibility, and are reproducible."""

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_fill_holes

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar_dashboards.rendering.body import body_of_fragment
from cutgrammar_dashboards.rendering.drawing import FRONT, draw, eye_towards

RED, BLUE = (220, 30, 30), (30, 30, 220)
TOP = eye_towards(0.0, -1e-6, 1.0)


def box(x, y, z, at=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box((x, y, z))
    return Fragment(Mesh(mesh.vertices, mesh.faces), Pose(np.eye(3), np.array(at)))


def middle_colour(picture):
    return picture.pixels[picture.pixels.shape[0] // 2, picture.pixels.shape[1] // 2].astype(int)


def test_a_drawing_is_as_large_as_its_bodies():
    picture = draw([body_of_fragment(box(0.10, 0.04, 0.02), RED)], TOP, 1000.0)
    opaque = picture.pixels[..., 3] > 127
    assert np.ptp(np.flatnonzero(opaque.any(axis=0))) + 1 == pytest.approx(100, abs=1)
    assert np.ptp(np.flatnonzero(opaque.any(axis=1))) + 1 == pytest.approx(40, abs=1)


@pytest.mark.parametrize("reversed_", [False, True])
def test_near_bodies_hide_far_ones_whatever_their_order(reversed_):
    bodies = [body_of_fragment(box(0.04, 0.04, 0.01, (0, 0, 0.05)), RED), body_of_fragment(box(0.10, 0.10, 0.01), BLUE)]
    seen = middle_colour(draw(bodies[::-1] if reversed_ else bodies, TOP, 800.0))
    assert seen[0] > 3 * seen[2]


def test_a_surface_has_no_holes(lump):
    picture = draw([body_of_fragment(Fragment(lump, Pose.identity()), RED)], FRONT, 2000.0)
    opaque = picture.pixels[..., 3] == 255
    assert np.array_equal(opaque, binary_fill_holes(opaque))


def test_points_are_located_in_the_drawing():
    picture = draw([body_of_fragment(box(0.10, 0.04, 0.02), RED)], TOP, 1000.0)
    shares = picture.locate(np.array([[0.0, 0.0, 0.0], [0.05, 0.02, 0.0]]))
    height, width, _ = picture.pixels.shape
    assert shares[0] == pytest.approx([0.5, 0.5], abs=1.5 / height)
    right, top = shares[1] * [width, height]
    opaque = picture.pixels[..., 3] > 127
    assert right == pytest.approx(np.flatnonzero(opaque.any(axis=0)).max() + 1, abs=1.5)
    assert top == pytest.approx(np.flatnonzero(opaque.any(axis=1)).min(), abs=1.5)


def test_a_shift_moves_a_body():
    moved = body_of_fragment(box(0.1, 0.1, 0.1), RED, np.array([1.0, 2.0, 3.0]))
    assert moved.vertices.mean(axis=0) == pytest.approx([1.0, 2.0, 3.0])


def test_the_same_bodies_give_the_same_pixels(lump):
    fragment = Fragment(lump, Pose.identity())
    once, again = (draw([body_of_fragment(fragment, RED)], FRONT, 900.0) for _ in range(2))
    assert np.array_equal(once.pixels, again.pixels)


def test_clouds_are_drawn(lump):
    picture = draw([body_of_fragment(Fragment(sample_surface(lump, 500), Pose.identity()), RED)], FRONT, 900.0)
    assert (picture.pixels[..., 3] > 0).mean() > 0.3


def test_a_drawing_without_bodies_is_refused():
    with pytest.raises(ValueError, match="nothing to show"):
        draw([], FRONT, 900.0)
