import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.canonical import FLIPS, _octants, canonical_frame, covariance, extents
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import solid_of


def test_axes_run_from_the_smallest_to_the_largest_variance(lump):
    X_FC = canonical_frame(lump)
    moment = X_FC.rotation.T @ covariance(lump) @ X_FC.rotation
    assert np.abs(moment - np.diag(np.diag(moment))).max() < 1e-12
    assert moment[0, 0] < moment[1, 1] < moment[2, 2]


def test_the_frame_moves_with_the_fragment(lump, random_pose, remeshed):
    X = random_pose()
    moved = canonical_frame(remeshed(lump, X))
    assert np.abs((X @ canonical_frame(lump)).rotation - moved.rotation).max() < 1e-9


def test_octant_volumes_are_exact(lump):
    X_CF = canonical_frame(lump).inverse()
    octants = _octants(lump, X_CF)
    solid = solid_of(lump.moved(X_CF))
    for x in (0, 1):
        solid_x = solid.trim_by_plane((1.0 - 2 * x, 0.0, 0.0), 0.0)
        for y in (0, 1):
            solid_y = solid_x.trim_by_plane((0.0, 1.0 - 2 * y, 0.0), 0.0)
            for z in (0, 1):
                volume = solid_y.trim_by_plane((0.0, 0.0, 1.0 - 2 * z), 0.0).volume()
                assert octants[4 * x + 2 * y + z] == pytest.approx(volume, rel=1e-9)


def test_the_first_octant_has_the_largest_volume_of_the_four_proper_sign_choices(lump):
    X_FC = canonical_frame(lump)
    first = [_octants(lump, (X_FC @ flip).inverse())[0] for flip in FLIPS]
    assert np.argmax(first) == 0


def test_moments_agree_with_trimesh(lump):
    reference = trimesh.Trimesh(lump.vertices, lump.faces)
    inertia = reference.moment_inertia  # at density 1
    expected = (np.trace(inertia) / 2 * np.eye(3) - inertia) / lump.volume
    assert np.allclose(covariance(lump), expected, rtol=1e-9, atol=1e-15)
    assert np.allclose(lump.centroid, reference.center_mass, atol=1e-12)
    assert lump.volume == pytest.approx(reference.volume, rel=1e-12)


def test_a_surface_cloud_has_nearly_the_canonical_frame_of_the_mesh(lump):
    cloud = sample_surface(lump, 4000)
    axis = canonical_frame(cloud).rotation[:, 2]
    assert abs(axis @ canonical_frame(lump).rotation[:, 2]) > 0.99


def test_extents_bound_the_shape(lump):
    X_FC = canonical_frame(lump)
    low, high = extents(lump, X_FC)
    seen = X_FC.inverse().apply(lump.vertices)
    assert (seen >= low).all()
    assert (seen <= high).all()


def test_shapes_without_volume_are_refused():
    flat = Mesh(np.eye(3), [[0, 1, 2], [0, 2, 1]])
    with pytest.raises(ValueError, match="positive volume"):
        canonical_frame(flat)
    with pytest.raises(ValueError, match="too few"):
        canonical_frame(Cloud(np.eye(3), np.eye(3)))


def test_the_volume_of_a_cloud_is_that_of_its_hull(rng):
    corners = np.array(list(np.ndindex(2, 2, 2)), dtype=float) * [0.1, 0.02, 0.03]
    points = np.concatenate([corners, rng.uniform(corners.min(axis=0), corners.max(axis=0), size=(50, 3))])
    assert Cloud(points, np.ones_like(points)).volume == pytest.approx(0.1 * 0.02 * 0.03)
