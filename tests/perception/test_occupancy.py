import numpy as np
import pytest

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.perception.occupancy import inside, winding_numbers
from simple_shapes import box_mesh


def test_a_box_contains_exactly_its_points(rng):
    points = rng.uniform(-0.03, 0.03, size=(4000, 3))
    assert (inside(box_mesh(0.04, 0.04, 0.04), points) == (np.abs(points).max(axis=1) < 0.02)).all()


def test_the_share_of_points_inside_is_the_volume(lump, rng):
    lowest, highest = lump.vertices.min(axis=0), lump.vertices.max(axis=0)
    share = inside(lump, rng.uniform(lowest, highest, size=(6000, 3))).mean()
    assert share * np.prod(highest - lowest) == pytest.approx(lump.volume, rel=0.03)


def test_winding_numbers_are_0_or_1_after_many_cuts(lump, rng):
    mesh = lump
    for _ in range(12):  # cuts close together leave slivers
        normal = rng.normal(size=3)
        sliced = slice_mesh(mesh, Plane.through(mesh.centroid + rng.normal(scale=1e-4, size=3), normal))
        if isinstance(sliced, Sliced):
            mesh = max(sliced.products, key=lambda product: product.volume)
    numbers = winding_numbers(mesh, rng.uniform(-0.05, 0.05, size=(1000, 3)))
    assert np.abs(numbers - np.round(numbers)).max() < 1e-9
    assert set(np.round(numbers)) <= {0.0, 1.0}


def test_triangles_without_area_change_nothing(lump, rng):
    points = rng.uniform(-0.05, 0.05, size=(500, 3))
    a, b, c = lump.faces[0]
    middle = (lump.vertices[a] + lump.vertices[b]) / 2
    m = len(lump.vertices)
    # Split the edge a-b on one side only; a triangle without area closes the gap.
    faces = np.concatenate([lump.faces[1:], [[a, m, c], [m, b, c], [a, b, m]]])
    split = Mesh(np.concatenate([lump.vertices, [middle]]), faces)
    assert np.abs(winding_numbers(split, points) - winding_numbers(lump, points)).max() < 1e-9
