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
        (((1, 1, -1), (1, 1, 1), (2, 1, 1)), True),  # pierces it
        (((1, 1, 0), (1, 1, 1), (2, 1, 1)), False),  # stands on it with a corner
        (((1, 1, 0), (2, 1, 0), (1, 1, 1)), False),  # stands on it with an edge
        (((0, 0, 0), (1, 1, -1), (1, 1, 1)), True),  # shares a corner and crosses
        (((0, 0, 0), (1, 1, 2), (1, 1, 1)), False),  # shares a corner and rises
        (((0, 0, 0), (4, 0, 0), (0, -4, 0)), False),  # its flat neighbour
        (((0, 0, 0), (4, 0, 0), (1, 1, 0)), True),  # shares an edge and is folded back flat
        (((0, 0, 0), (4, 0, 0), (0, 4, 1)), False),  # shares an edge and is folded, not flat
        (((0, 0, 0), (-1, 0, 0), (0, -1, 0)), False),  # flat, shares a corner, points away
        (((0, 0, 0), (3, 1, 0), (1, 3, 0)), True),  # flat, shares a corner, lies on it
        (((5, 5, 0), (9, 5, 0), (5, 9, 0)), False),  # flat and elsewhere
        (((1, 1, 1), (2, 1, 1), (1, 2, 1)), False),  # above it
        (FLOOR, True),  # the same again
    ],
)
def test_two_triangles_overlap_only_where_they_cannot_be_parted_for_nothing(other, overlap, random_pose):
    for pose in (Pose.identity(), random_pose(), random_pose()):
        pair = triangles(FLOOR, other).moved(pose)
        assert (len(self_intersections(pair)) == 1) == overlap
        turned = Mesh(pair.vertices, pair.faces[::-1, ::-1])
        assert (len(self_intersections(turned)) == 1) == overlap


def test_two_overlapping_shells_are_found():
    ball = trimesh.creation.icosphere(3, 0.03)
    beside = ball.copy()
    beside.apply_translation([0.04, 0.003, 0.001])
    found = self_intersections(mesh_of(ball, beside), most=1000)
    assert len(found) > 20
    assert (found[:, 0] < len(ball.faces)).all()
    assert (found[:, 1] >= len(ball.faces)).all()


@pytest.mark.parametrize("shift", [(0.5, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.5, 0.5), (0.3, 0.2, 0.1)])
def test_overlapping_boxes_are_found_though_their_sides_lie_in_one_plane(shift):
    assert len(self_intersections(mesh_of(box(0, 0, 0), box(*shift))))


def test_boxes_apart_and_boxes_edge_to_edge_are_fine():
    assert not len(self_intersections(mesh_of(box(0, 0, 0), box(1.5, 0, 0))))
    assert not len(self_intersections(mesh_of(box(0, 0, 0), box(1, 1, 0))))


def test_two_boxes_that_share_a_side_overlap_there():
    assert len(self_intersections(mesh_of(box(0, 0, 0), box(1, 0, 0))))


def test_a_bent_tube_that_runs_into_itself_is_found():
    straight = trimesh.creation.cylinder(0.2, 7.0, sections=12).subdivide().subdivide().subdivide()
    for turn, crosses in ((0.9, False), (1.1, True)):
        x, y, z = straight.vertices.T
        angle = turn * 2.0 * np.pi * z / 7.0
        bent = np.stack([(1.0 + x) * np.cos(angle), (1.0 + x) * np.sin(angle), y], axis=1)
        assert bool(len(self_intersections(Mesh(bent, straight.faces)))) == crosses


@pytest.mark.parametrize("name", names_in(FOODS))
def test_no_food_and_no_fragment_of_it_runs_into_itself(name, random_pose):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        mesh = load(reference_of(FOODS, name))(rng)
        assert not len(self_intersections(mesh))
        sliced = slice_mesh(mesh.moved(random_pose()), Plane.through(np.zeros(3), rng.normal(size=3)))
        if isinstance(sliced, Sliced):
            for product in sliced.products:
                assert not len(self_intersections(product))


def test_neither_the_pose_nor_the_order_of_the_faces_matters(remeshed, random_pose, lump):
    dented = Mesh(np.where(lump.vertices[:, 2:] > 0.055, [0.0, 0.0, -0.08], lump.vertices), lump.faces)
    for mesh, crosses in ((lump, False), (dented, True)):
        assert bool(len(self_intersections(mesh))) == crosses
        assert bool(len(self_intersections(remeshed(mesh, random_pose())))) == crosses


@pytest.mark.timeout(120)  # comparing every pair of faces would take hours
def test_not_every_pair_of_faces_is_compared():
    ball = trimesh.creation.icosphere(6, 0.05)
    assert not len(self_intersections(Mesh(ball.vertices[:], ball.faces)))
    assert len(ball.faces) > 50_000
