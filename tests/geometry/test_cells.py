import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.canonical import FLIPS
from cutgrammar.geometry.cells import cell_volumes
from cutgrammar.geometry.slicing import solid_of
from simple_shapes import as_mesh, box_mesh

SIZES = np.array([0.012, 0.015, 0.021])


def test_cell_volumes_equal_those_of_boolean_intersections(lump):
    volumes = cell_volumes(lump.triangles, SIZES, 2)
    solid = solid_of(lump)
    edges = [np.array([-1.0, -size, 0.0, size, 1.0]) for size in SIZES]
    for i in range(4):
        for j in range(4):
            for k in range(4):
                low = np.array([edges[0][i], edges[1][j], edges[2][k]])
                high = np.array([edges[0][i + 1], edges[1][j + 1], edges[2][k + 1]])
                box = trimesh.creation.box(bounds=[low, high])
                shared = (solid ^ solid_of(as_mesh(box))).volume()
                assert volumes[i, j, k] == pytest.approx(shared, rel=1e-9, abs=1e-15)


def test_cell_volumes_sum_to_the_volume_and_do_not_depend_on_the_triangulation(lump, remeshed):
    other = remeshed(lump, FLIPS[0])
    for half, size in ((1, 1.0), (3, 0.01), (9, 0.003)):
        cells = cell_volumes(lump.triangles, np.full(3, size), half)
        assert cells.sum() == pytest.approx(lump.volume, rel=1e-12)
        assert np.abs(cells - cell_volumes(other.triangles, np.full(3, size), half)).max() < 1e-12 * lump.volume


def test_a_flip_reverses_axes(lump):
    cells = cell_volumes(lump.triangles, SIZES, 3)
    flipped = cell_volumes(lump.moved(FLIPS[2]).triangles, SIZES, 3)
    assert np.abs(flipped - cells[::-1, :, ::-1]).max() < 1e-12 * lump.volume


def test_faces_on_cell_boundaries_count_once():
    cells = cell_volumes(box_mesh(0.04, 0.02, 0.02).triangles, np.full(3, 0.01), 3)
    assert np.count_nonzero(cells > 1e-12) == 16
    assert cells.sum() == pytest.approx(1.6e-5, rel=1e-12)
