import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh, solid_of
from cutgrammar.plugins import FOODS, load, names_in, reference_of
from cutgrammar_sim.foods import ON_REQUEST, PROPORTIONS

NAMES = sorted(PROPORTIONS)
ALL = sorted({**PROPORTIONS, **ON_REQUEST})


def food(name: str, seed: int) -> Mesh:
    return load(reference_of(FOODS, name))(np.random.default_rng(seed))


def test_every_food_is_registered():
    assert set(ALL) <= set(names_in(FOODS))


@pytest.mark.parametrize("name", ALL)
def test_every_food_is_a_closed_outward_connected_solid(name):
    for seed in range(20):
        mesh = food(name, seed)
        seen = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert seen.is_watertight
        assert seen.is_winding_consistent
        assert seen.body_count == 1
        assert seen.euler_number == 2
        assert mesh.volume > 0
        assert 400 <= len(mesh.faces) <= 1000
        assert solid_of(mesh).volume() == pytest.approx(mesh.volume, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_every_food_is_centred_along_x_and_has_its_proportions(name):
    *sides, _ = PROPORTIONS[name]
    for seed in range(20):
        mesh = food(name, seed)
        extents = np.ptp(mesh.vertices, axis=0)
        assert np.abs(mesh.centroid).max() < 1e-12
        assert extents[0] > 1.3 * extents[1]
        for extent, (smallest, largest) in zip(extents, sides, strict=True):
            assert 0.85 * smallest < extent < 1.2 * largest


@pytest.mark.parametrize("name", ALL)
def test_the_random_stream_determines_the_food(name):
    assert (food(name, 3).vertices == food(name, 3).vertices).all()
    assert np.abs(food(name, 3).vertices - food(name, 4).vertices).max() > 1e-4


@pytest.mark.parametrize("name", ["carrot", "courgette"])
def test_tapered_foods_are_thicker_towards_positive_x(name):
    for seed in range(10):
        vertices = food(name, seed).vertices
        x = vertices[:, 0] / np.ptp(vertices[:, 0])
        ends = [np.ptp(vertices[(x > at - 0.06) & (x < at + 0.06)][:, 1:], axis=0).mean() for at in (-0.3, 0.3)]
        assert ends[1] > 1.02 * ends[0]


@pytest.mark.parametrize("name", sorted(ON_REQUEST))
def test_foods_on_request_are_centred_and_have_their_height(name):
    *_, (smallest, largest), _ = ON_REQUEST[name]
    for seed in range(20):
        mesh = food(name, seed)
        assert np.abs(mesh.centroid).max() < 1e-12
        assert 0.85 * smallest < np.ptp(mesh.vertices[:, 2]) < 1.2 * largest


def test_a_plane_across_y_divides_a_banana_into_three_and_other_foods_into_two():
    for name in ALL:
        for seed in range(20):
            mesh = food(name, seed)
            middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
            products = [len(slice_mesh(mesh, Plane.through(middle, axis)).products) for axis in np.eye(3)]
            assert products == [2, 3 if name == "banana" else 2, 2]
