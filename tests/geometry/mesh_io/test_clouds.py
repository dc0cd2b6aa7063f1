import numpy as np
import pytest
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.mesh_io.clouds import oriented_cloud, solid_from
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import solid_of


def mesh_of(made):
    return Mesh(made.vertices, made.faces)


def iou(a, b):
    shared = (solid_of(a) ^ solid_of(b)).volume()
    return shared / (a.volume + b.volume - shared)


SHAPES = {
    "block": (trimesh.creation.box((0.1, 0.05, 0.04)), 0.95),
    "disc": (trimesh.creation.cylinder(0.03, 0.008), 0.92),
    "ring": (trimesh.creation.annulus(0.01, 0.03, 0.02), 0.92),
    "rod": (trimesh.creation.cylinder(0.01, 0.18), 0.88),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("given", [True, False])
def test_the_surface_through_a_cloud_is_that_it_was_sampled_from(name, given):
    made, enough = SHAPES[name]
    cloud = sample_surface(mesh_of(made), 1500)
    found, _ = oriented_cloud(cloud.points, cloud.normals if given else None)
    assert iou(solid_from(found), mesh_of(made)) > enough


def test_inward_and_contradictory_normals_are_noticed(lump):
    cloud = sample_surface(lump, 800)
    rng = np.random.default_rng(0)
    order = np.lexsort(cloud.points.T[::-1])
    for normals, note in (
        (cloud.normals, ()),
        (-3.0 * cloud.normals, ("its normals pointed inwards and were turned",)),
        (rng.normal(size=(800, 3)), ("its normals contradict one another; they were estimated",)),
        (cloud.normals * 0, ("some normals were zero or not finite; all were estimated",)),
    ):
        found, notes = oriented_cloud(cloud.points, normals)
        assert notes == note
        assert (np.einsum("ij,ij->i", found.normals, cloud.normals[order]) > 0).mean() > 0.97


def test_a_cloud_of_one_side_is_refused_and_the_side_is_named(lump):
    cloud = sample_surface(lump, 2000)
    upper = cloud.points[:, 2] > np.median(cloud.points[:, 2])
    with pytest.raises(InputError, match="misses its surface towards -z"):
        solid_from(Cloud(cloud.points[upper], cloud.normals[upper]))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((5, 3)), "has 5 points and no triangles"),
        (np.random.default_rng(0).normal(size=(200, 3)) * [1, 1, 0], "is flat: its points are coplanar"),
        (np.full((200, 3), np.nan), "not finite"),
    ],
)
def test_points_without_a_body_are_refused(points, message):
    with pytest.raises(InputError, match=message):
        oriented_cloud(points, None)
