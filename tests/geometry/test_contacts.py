import numpy as np
import pytest

from cutgrammar.geometry.contacts import contact_planes
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import slice_mesh
from simple_shapes import box_fragment


def cut_by(mesh, pose, *planes):
    meshes = [mesh]
    for plane in planes:
        meshes = [product for m in meshes for product in getattr(slice_mesh(m, plane), "products", (m,))]
    return tuple(Fragment(m, pose) for m in meshes)


def test_the_products_of_a_cut_touch_on_its_plane(lump, random_pose):
    pose, plane = random_pose(), Plane.through(lump.centroid, np.array([0.1, 0.2, 1.0]))
    goal = cut_by(lump, pose, plane)
    (found,) = contact_planes(goal)
    wanted = plane.transformed(pose).to_vector()
    assert min(np.abs(found.plane_W.to_vector() - sign * wanted).max() for sign in (1, -1)) < 1e-9
    area, covered = found.coverage(Fragment(lump, pose))
    assert area == pytest.approx(found.area, rel=1e-6)
    assert covered == pytest.approx(1.0, abs=1e-6)


def test_contacts_do_not_depend_on_order_or_meshing(lump, remeshed, random_pose):
    pose = random_pose()
    planes = [Plane.through(lump.centroid, n) for n in (np.array([0.0, 0.1, 1.0]), np.array([1.0, 0.1, 0.0]))]
    goal = cut_by(lump, pose, *planes)
    other = tuple(Fragment(remeshed(f.mesh, Pose.identity()), pose) for f in reversed(goal))
    for first, second in zip(contact_planes(goal), contact_planes(other), strict=True):
        assert first.plane_W.to_vector() == pytest.approx(second.plane_W.to_vector(), abs=1e-7)
        assert first.area == pytest.approx(second.area, rel=1e-5)


def test_a_plane_that_ends_at_another_covers_only_part_of_the_section(lump):
    across = Plane.through(lump.centroid, np.array([0.0, 0.0, 1.0]))
    along = Plane.through(lump.centroid, np.array([1.0, 0.0, 0.0]))
    upper, lower = cut_by(lump, Pose.identity(), across)
    goal = (*cut_by(upper.mesh, upper.X_WF, along), lower)
    whole = Fragment(lump, Pose.identity())
    covered = sorted(plane.coverage(whole)[1] for plane in contact_planes(goal))
    assert covered[1] == pytest.approx(1.0, abs=1e-6)
    assert 0.3 < covered[0] < 0.7


@pytest.mark.parametrize(
    ("shift", "planes"),
    [([0.02, 0.0, 0.0], 1), ([0.0201, 0.0, 0.0], 1), ([0.021, 0.0, 0.0], 0), ([0.02, 0.05, 0.0], 0)],
    ids=["touching", "0.1 mm apart", "1 mm apart", "side by side"],
)
def test_fragments_touch_where_faces_lie_against_each_other(shift, planes):
    pair = (box_fragment([0.02] * 3, [0.0, 0.0, 0.0]), box_fragment([0.02] * 3, shift))
    assert len(contact_planes(pair)) == planes


def test_faces_with_equal_normals_do_not_touch():
    assert contact_planes((box_fragment([0.02] * 3, [0.0, 0.0, 0.0]), box_fragment([0.02] * 3, [0.0, 0.03, 0.0]))) == ()
    assert contact_planes(()) == ()
