"""Laws of slicing on random cut sequences; benchmarks/cut_sequences.py runs 2,000 of them."""

import numpy as np
import pytest

import cut_sequences
from cutgrammar import seeds
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed, Sliced, slice_mesh
from cutgrammar.plugins import FOODS, load, names_in, reference_of
from simple_shapes import box_mesh

NAMES = names_in(FOODS)


@pytest.mark.parametrize("name", NAMES)
def test_random_cuts_give_closed_fragments_conserve_volume_and_keep_vertices_on_their_sides(name):
    for sequence in range(4):
        outcome = cut_sequences.play(name, 10, seeds.stream(1, "slicing laws", name, sequence))
        assert outcome.cuts == 10
        assert outcome.fragments >= 11
        assert outcome.passed, outcome


@pytest.mark.parametrize("name", NAMES)
def test_reversing_the_normal_exchanges_the_products_of_the_two_sides(name, rng):
    mesh = load(reference_of(FOODS, name))(rng)
    plane = Plane.through(mesh.vertices.mean(axis=0), rng.normal(size=3))
    one, other = slice_mesh(mesh, plane), slice_mesh(mesh, Plane(-plane.normal, -plane.offset))
    assert isinstance(one, Sliced)
    assert isinstance(other, Sliced)
    for a, b in ((one.above, other.below), (one.below, other.above)):
        assert [p.volume for p in a] == pytest.approx([p.volume for p in b], rel=1e-9)


def test_a_plane_through_the_side_of_a_box_or_beside_it_misses():
    box = box_mesh(0.05, 0.05, 0.05).moved(Pose(np.eye(3), np.full(3, 0.025)))
    for point in (0.0, 0.05, 0.06, 0.05 - 1e-9, 1e-9):
        for axis in np.eye(3):
            assert isinstance(slice_mesh(box, Plane.through(point * axis, axis)), Missed)
    for axis in np.eye(3):
        assert isinstance(slice_mesh(box, Plane.through(0.02 * axis, axis)), Sliced)
