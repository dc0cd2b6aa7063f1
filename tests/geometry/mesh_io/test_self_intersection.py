import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.self_intersection import self_intersections
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.plugins import FOODS, load, names_in, reference_of


def mesh_of(*parts: trimesh.Trimesh) -> Mesh:
    whole = trimesh.util.concatenate(parts)
    return Mesh(whole.vertices, whole.faces)


def box(*corner: float) -> trimesh.Trimesh:
    made = trimesh.creation.box((1, 1, 1))
    made.apply_translation(corner)
    return made


def triangles(*corners) -> Mesh:
    return Mesh(np.array(corners, dtype=float).reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


FLOOR = ((0, 0, 0), (4, 0, 0), (0, 4, 0))


@pytest.mark.parametrize(
    ("other", "overlap"),
    [
        (((1, 1, -1), (1, 1, 1), (2, 1, 1)), True),  # pierces the floor
        (((1, 1, 0), (1, 1, 1), (2, 1, 1)), False),  # touches it with a vertex
        (((1, 1, 0), (2, 1, 0), (1, 1, 1)), False),  # touches it with an edge
        (((0, 0, 0), (1, 1, -1), (1, 1, 1)), True),  # shares a vertex and crosses
        (((0, 0, 0), (1, 1, 2), (1, 1, 1)), False),  # shares a vertex and leaves the plane
        (((0, 0, 0), (4, 0, 0), (0, -4, 0)), False),  # coplanar neighbour
        (((0, 0, 0), (4, 0, 0), (1, 1, 0)), True),  # shares an edge and is folded back onto it
        (((0, 0, 0), (4, 0, 0), (0, 4, 1)), False),  # shares an edge at an angle
        (((0, 0, 0), (-1, 0, 0), (0, -1, 0)), False),  # coplanar, shares a vertex, points away
        (((0, 0, 0), (3, 1, 0), (1, 3, 0)), True),  # coplanar, shares a vertex, overlaps
        (((5, 5, 0), (9, 5, 0), (5, 9, 0)), False),  # coplanar and disjoint
        (((1, 1, 1), (2, 1, 1), (1, 2, 1)), False),  # above the floor
        (FLOOR, True),  # the same triangle
    ],
)
def test_triangles_that_only_touch_do_not_overlap(other, overlap, random_pose):
    for pose in (Pose.identity(), random_pose(), random_pose()):
        pair = triangles(FLOOR, other).moved(pose)
        assert (len(self_intersections(pair)) == 1) == overlap
        turned = Mesh(pair.vertices, pair.faces[::-1, ::-1])
        assert (len(self_intersections(turned)) == 1) == overlap


def test_two_overlapping_shells_are_found():
    ball = trimesh.creation.icosphere(3, 0.03)
    beside = ball.copy()
    beside.apply_translation([0.04, 0.003, 0.001])
    found = self_intersections(mesh_of(ball, beside), max_pairs=1000)
    assert len(found) > 20
    assert (found[:, 0] < len(ball.faces)).all()
    assert (found[:, 1] >= len(ball.faces)).all()


@pytest.mark.parametrize("shift", [(0.5, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.5, 0.5), (0.3, 0.2, 0.1)])
def test_overlapping_boxes_with_coplanar_sides_are_found(shift):
    assert len(self_intersections(mesh_of(box(0, 0, 0), box(*shift))))


def test_disjoint_boxes_and_boxes_edge_to_edge_do_not_intersect():
    assert not len(self_intersections(mesh_of(box(0, 0, 0), box(1.5, 0, 0))))
    assert not len(self_intersections(mesh_of(box(0, 0, 0), box(1, 1, 0))))


def test_boxes_that_share_a_side_overlap_on_it():
    assert len(self_intersections(mesh_of(box(0, 0, 0), box(1, 0, 0))))


def test_a_bent_tube_that_intersects_itself_is_found():
    straight = trimesh.creation.cylinder(0.2, 7.0, sections=12).subdivide().subdivide().subdivide()
    for turn, crosses in ((0.9, False), (1.1, True)):
        x, y, z = straight.vertices.T
        angle = turn * 2.0 * np.pi * z / 7.0
        bent = np.stack([(1.0 + x) * np.cos(angle), (1.0 + x) * np.sin(angle), y], axis=1)
        assert bool(len(self_intersections(Mesh(bent, straight.faces)))) == crosses


@pytest.mark.parametrize("name", names_in(FOODS))
def test_foods_and_their_fragments_do_not_intersect_themselves(name, random_pose):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        mesh = load(reference_of(FOODS, name))(rng)
        assert not len(self_intersections(mesh))
        sliced = slice_mesh(mesh.moved(random_pose()), Plane.through(np.zeros(3), rng.normal(size=3)))
        if isinstance(sliced, Sliced):
            for product in sliced.products:
                assert not len(self_intersections(product))


def test_the_result_does_not_depend_on_pose_and_order_of_faces(remeshed, random_pose, lump):
    dented = Mesh(np.where(lump.vertices[:, 2:] > 0.055, [0.0, 0.0, -0.08], lump.vertices), lump.faces)
    for mesh, crosses in ((lump, False), (dented, True)):
        assert bool(len(self_intersections(mesh))) == crosses
        assert bool(len(self_intersections(remeshed(mesh, random_pose())))) == crosses


@pytest.mark.timeout(120)  # comparing all pairs of faces would take hours
def test_not_all_pairs_of_faces_are_compared():
    ball = trimesh.creation.icosphere(6, 0.05)
    assert not len(self_intersections(Mesh(ball.vertices[:], ball.faces)))
    assert len(ball.faces) > 50_000
