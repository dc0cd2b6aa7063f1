import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Missed, Sliced, slice_mesh
from simple_shapes import as_mesh, box_mesh


def test_products_add_up_to_the_volume_and_lie_on_their_sides(lump, rng):
    plane = Plane.through(lump.centroid, rng.normal(size=3))
    cut = slice_mesh(lump, plane)
    assert isinstance(cut, Sliced)
    assert sum(p.volume for p in cut.products) == pytest.approx(lump.volume, rel=1e-12)
    assert all(plane.distances(p.vertices).min() > -1e-9 for p in cut.above)
    assert all(plane.distances(p.vertices).max() < 1e-9 for p in cut.below)
    assert all(trimesh.Trimesh(p.vertices, p.faces).is_watertight for p in cut.products)


@pytest.mark.parametrize("offset", [-1.0, 1.0])
def test_a_plane_outside_the_mesh_misses_it(lump, offset):
    assert isinstance(slice_mesh(lump, Plane(np.array([0.0, 0.0, 1.0]), offset)), Missed)


def test_a_plane_on_a_face_of_a_box_grazes_it():
    box = box_mesh(0.1, 0.1, 0.1)
    missed = slice_mesh(box, Plane(np.array([0.0, 0.0, 1.0]), -0.05))
    assert isinstance(missed, Missed)


def test_a_cut_with_a_tiny_product_is_a_graze():
    box = box_mesh(0.1, 0.1, 0.1)
    missed = slice_mesh(box, Plane(np.array([0.0, 0.0, 1.0]), -0.04999), min_share=1e-3)
    assert isinstance(missed, Missed)
    assert "grazes" in missed.reason


def test_a_half_with_two_components_gives_two_products():
    horseshoe = trimesh.boolean.difference(
        [
            trimesh.creation.box((0.1, 0.1, 0.02)),
            trimesh.creation.box((0.04, 0.12, 0.04)).apply_translation([0, 0.04, 0]),
        ]
    )
    cut = slice_mesh(as_mesh(horseshoe), Plane(np.array([0.0, 1.0, 0.0]), -0.02))
    assert isinstance(cut, Sliced)
    assert (len(cut.above), len(cut.below)) == (2, 1)


def test_a_half_with_a_cavity_is_one_product():
    shell = trimesh.boolean.difference(
        [trimesh.creation.icosphere(3, 0.05), trimesh.creation.icosphere(2, 0.01).apply_translation([0, 0, 0.025])]
    )
    cut = slice_mesh(as_mesh(shell), Plane(np.array([0.0, 0.0, 1.0]), 0.0))
    assert isinstance(cut, Sliced)
    assert (len(cut.above), len(cut.below)) == (1, 1)


def test_an_open_mesh_is_refused():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match="not a closed"):
        slice_mesh(Mesh(box.vertices, box.faces[:-1]), Plane(np.array([0.0, 0.0, 1.0]), 0.0))
