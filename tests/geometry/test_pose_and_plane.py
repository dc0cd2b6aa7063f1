import pickle

import numpy as np
import pytest

from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose


def test_a_pose_survives_the_round_trip_through_a_vector(random_pose):
    X = random_pose()
    again = Pose.from_vector(X.to_vector())
    assert np.abs(again.rotation - X.rotation).max() < 1e-12
    assert np.abs(again.position - X.position).max() == 0


def test_a_pose_times_its_inverse_is_the_identity(random_pose, rng):
    X = random_pose()
    points = rng.normal(size=(5, 3))
    assert np.allclose((X @ X.inverse()).apply(points), points, atol=1e-14)


def test_transforming_a_plane_keeps_the_distances(random_pose, rng):
    plane = Plane.through(rng.normal(size=3), rng.normal(size=3))
    points = rng.normal(size=(9, 3))
    X = random_pose()
    assert np.allclose(plane.distances(points), plane.transformed(X).distances(X.apply(points)), atol=1e-13)


def test_values_stay_read_only_after_pickling(lump, random_pose):
    mesh, pose = pickle.loads(pickle.dumps((lump, random_pose())))
    for array in (mesh.vertices, mesh.faces, pose.rotation):
        assert not array.flags.writeable


@pytest.mark.parametrize("vector", [np.zeros(7), np.ones(6), [np.nan] * 7])
def test_vectors_that_are_not_poses_are_refused(vector):
    with pytest.raises(ValueError, match="pose|quaternion"):
        Pose.from_vector(vector)


def test_a_normal_that_is_not_a_unit_vector_is_refused():
    with pytest.raises(ValueError, match="length 2"):
        Plane(np.array([0.0, 0.0, 2.0]), 0.0)


def test_copies_of_a_plane_are_identical(rng):
    for normal in rng.normal(size=(2000, 3)):
        plane = Plane.through(rng.normal(size=3), normal)
        for copy in (Plane(plane.normal, plane.offset), pickle.loads(pickle.dumps(plane))):
            assert np.array_equal(copy.to_vector(), plane.to_vector())
