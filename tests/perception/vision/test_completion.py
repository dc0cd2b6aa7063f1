import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.perception.vision.completion import complete
from cutgrammar.perception.vision.convex_parts import hull
from simple_shapes import as_mesh, box_mesh


def closed(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces).is_watertight


def on_board(mesh):
    return mesh.moved(Pose(np.eye(3), np.array([0.0, 0.0, -mesh.vertices[:, 2].min()])))


def sphere(radius):
    return on_board(as_mesh(trimesh.creation.icosphere(4, radius)))


def box(*size):
    return on_board(box_mesh(*size))


@pytest.mark.parametrize("mesh", [sphere(0.025), box(0.04, 0.03, 0.02)], ids=["round", "square"])
def test_the_completion_of_a_full_surface_keeps_its_volume(mesh):
    cloud = sample_surface(mesh, 6000)
    whole = complete(cloud.points, cloud.normals)
    assert closed(whole)
    assert whole.volume == pytest.approx(mesh.volume, rel=0.06)
    assert np.linalg.norm(whole.centroid - mesh.centroid) < 3e-4


@pytest.mark.parametrize("mesh", [sphere(0.025), box(0.04, 0.03, 0.02)], ids=["round", "square"])
def test_the_completion_of_a_view_from_above_has_about_the_true_volume(mesh):
    cloud = sample_surface(mesh, 6000)
    seen = cloud.normals[:, 2] > -0.3
    whole, part = (
        complete(cloud.points[seen], cloud.normals[seen]),
        hull(cloud.points[seen & (cloud.points[:, 2] > 1e-3)]),
    )
    assert closed(whole)
    assert whole.volume == pytest.approx(mesh.volume, rel=0.15)
    assert part.volume < whole.volume
    assert whole.vertices[:, 2].min() > -1e-9


def test_a_fragment_on_top_of_another_is_not_extended_to_the_board():
    mesh = box(0.03, 0.03, 0.01).moved(Pose(np.eye(3), np.array([0.0, 0.0, 0.03])))
    cloud = sample_surface(mesh, 3000)
    seen = cloud.normals[:, 2] > -0.3
    assert complete(cloud.points[seen], cloud.normals[seen]).volume == pytest.approx(mesh.volume, rel=0.15)


def test_the_order_of_the_points_changes_only_rounding(rng):
    cloud = sample_surface(sphere(0.02), 2000)
    order = rng.permutation(2000)
    whole, again = (complete(cloud.points[i], cloud.normals[i]) for i in (np.arange(2000), order))
    assert again.volume == pytest.approx(whole.volume, rel=1e-9)


def test_too_few_points_or_a_flat_patch_give_no_mesh():
    flat = np.column_stack([np.random.default_rng(0).uniform(0.0, 0.02, size=(200, 2)), np.full(200, 0.01)])
    assert complete(flat[:5], np.tile([0.0, 0.0, 1.0], (5, 1))) is None
    assert hull(flat) is None


def test_a_hull_faces_outward():
    mesh = hull(box(0.01, 0.02, 0.03).vertices)
    assert mesh.volume == pytest.approx(6e-6)
    assert closed(mesh)
