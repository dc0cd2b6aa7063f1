import itertools

import numpy as np
import pytest

from cutgrammar.geometry.comparison.overlap import Solid, iou
from cutgrammar.geometry.comparison.refinement import refined_iou
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh
from simple_shapes import box_mesh


def near_cube(rng, tilt_deg=2.0, size=(1.0, 1.0, 1.0)):
    """A cube with three sides cut off at slightly skewed planes."""
    mesh = box_mesh(*np.multiply(size, 0.05))
    for axis in range(3):
        normal = np.eye(3)[axis] + np.tan(np.radians(tilt_deg)) * rng.normal(size=3)
        at = np.eye(3)[axis] * 0.02 * size[axis]
        mesh = max(slice_mesh(mesh, Plane.through(at, normal)).products, key=lambda product: product.volume)
    return Solid(mesh)


def test_near_cubes_with_ill_defined_axes_have_a_high_refined_iou(rng):
    cubes = [near_cube(rng) for _ in range(6)]
    pairs = list(itertools.pairwise(cubes))
    plain = np.array([iou(a, b) for a, b in pairs])
    refined = np.array([refined_iou(a, b, p) for (a, b), p in zip(pairs, plain, strict=True)])
    assert plain.mean() < 0.85
    assert refined.min() > 0.88


def test_the_refined_iou_is_at_least_the_plain_iou(rng):
    solids = [near_cube(rng, 8.0, rng.uniform(0.5, 1.5, 3)) for _ in range(6)]
    for a in solids:
        for b in solids:
            plain = iou(a, b)
            assert plain <= refined_iou(a, b, plain) <= 1.0 + 1e-9


def test_the_refined_iou_of_boxes_is_the_known_value():
    a, b = Solid(box_mesh(0.03, 0.04, 0.06)), Solid(box_mesh(0.03, 0.04, 0.05))
    assert refined_iou(a, b, iou(a, b)) == pytest.approx(5 / 6, abs=1e-9)


def test_pose_and_triangulation_change_the_result_by_less_than_the_resolution_of_the_search(
    rng, random_pose, remeshed, lump
):
    other = Mesh(lump.vertices * [1.0, 1.2, 0.8] + 0.002 * np.cos(60 * lump.vertices[:, [2, 0, 1]]), lump.faces)
    a, b = Solid(lump), Solid(other)
    expected = refined_iou(a, b, iou(a, b))
    for _ in range(3):
        moved = [Solid(remeshed(mesh, random_pose())) for mesh in (lump, other)]
        assert refined_iou(*moved, iou(*moved)) == pytest.approx(expected, abs=1e-6)


def test_refinement_is_deterministic(rng, lump):
    cube = near_cube(rng).mesh
    assert refined_iou(Solid(cube), Solid(lump), 0.0) == refined_iou(Solid(cube), Solid(lump), 0.0)
