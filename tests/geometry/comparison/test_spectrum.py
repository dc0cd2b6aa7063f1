import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.comparison.spectrum import frequencies, spectral_distance
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh
from simple_shapes import as_mesh, box_mesh


def test_a_sphere_has_the_eigenvalues_of_the_spherical_harmonics():
    found = frequencies(as_mesh(trimesh.creation.icosphere(4, 0.05))) ** 2 * 0.05**2
    assert found == pytest.approx([2.0] * 3 + [6.0] * 5, rel=2e-3)


def test_the_eigenvalues_of_a_long_tube_follow_from_its_length():
    tube = frequencies(as_mesh(trimesh.creation.cylinder(0.001, 0.2, sections=64)))
    assert tube[:2] == pytest.approx(np.pi / 0.2 * np.array([1, 2]), rel=0.02)


def test_frequencies_do_not_depend_on_pose_order_and_triangulation(lump, random_pose, remeshed):
    expected = frequencies(lump)
    for _ in range(3):
        assert frequencies(remeshed(remeshed(lump, random_pose()), random_pose())) == pytest.approx(expected, rel=1e-9)


def test_slivers_do_not_change_the_frequencies(lump, rng):
    whole = slice_mesh(lump, Plane.through(lump.centroid, [0.0, 0.0, 1.0])).products[0]
    # A fan from a point close to an edge in the plane of the cut has triangles with almost no area.
    face = np.argmin(np.abs(whole.triangles[:, :, 2].mean(axis=1) - lump.centroid[2]))
    a, b, c = whole.faces[face]
    v = whole.vertices
    new = (1 - 1e-9) * (v[a] + v[b]) / 2 + 1e-9 * v[c]
    n = len(v)
    rest = np.delete(whole.faces, face, axis=0)
    split = Mesh(np.vstack([v, new]), np.vstack([rest, [[a, n, c], [n, b, c], [a, b, n]]]))
    assert spectral_distance(frequencies(split), frequencies(whole)) < 1e-7


def test_frequencies_scale_with_one_over_the_size(lump):
    larger = frequencies(Mesh(1.2 * lump.vertices, lump.faces))
    assert larger == pytest.approx(frequencies(lump) / 1.2, rel=1e-9)
    assert spectral_distance(larger, frequencies(lump)) == pytest.approx(1 / 6, abs=1e-9)


def test_the_distance_is_symmetric_between_0_and_1_and_distinguishes_shapes(lump):
    shapes = [lump, *(box_mesh(*size) for size in ((0.01, 0.04, 0.04), (0.02, 0.02, 0.09)))]
    found = [frequencies(shape) for shape in shapes]
    for i, a in enumerate(found):
        for j, b in enumerate(found):
            assert spectral_distance(a, b) == spectral_distance(b, a)
            assert spectral_distance(a, b) == 0.0 if i == j else 0.1 < spectral_distance(a, b) < 1.0


def test_frequencies_of_a_tetrahedron_exist_although_polynomials_coincide_on_it():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]) / 20
    found = frequencies(Mesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert np.all(found > 0.0)
