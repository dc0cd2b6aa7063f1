import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import solid_of
from cutgrammar.perception.vision.belief import Believed, KnownCut, predict
from cutgrammar.perception.vision.completion import WHOLE, complete
from cutgrammar.perception.vision.conservation import Found, divided_by
from cutgrammar.perception.vision.convex_parts import closed_around, hull
from cutgrammar.seeds import stream
from cutgrammar_sim import foods
from cutgrammar_sim.worlds.perceived import scanned_goal
from simple_shapes import as_mesh, box_mesh


@pytest.fixture(scope="module")
def banana():
    mesh = foods.banana(stream(0, "banana"))
    return mesh.moved(Pose(np.eye(3), np.array([0.0, 0.0, -mesh.vertices[:, 2].min()])))


@pytest.fixture(scope="module")
def seen(banana):
    """What is seen of the banana from above."""
    cloud = sample_surface(banana, 4000)
    above = cloud.normals[:, 2] > -0.3
    return cloud.points[above], cloud.normals[above]


def iou(a, b):
    a, b = solid_of(a), solid_of(b)
    both = (a ^ b).volume()
    return both / (a.volume() + b.volume() - both)


def test_the_completion_of_a_bent_fragment_keeps_its_hollow(banana, seen):
    completed = complete(*seen, WHOLE)
    assert trimesh.Trimesh(completed.vertices, completed.faces).is_watertight
    assert len(solid_of(completed).decompose()) == 1
    assert iou(hull(banana.vertices), banana) < 0.65
    assert iou(completed, banana) > 0.85
    assert complete(*seen, WHOLE).vertices.tobytes() == completed.vertices.tobytes()


def test_the_goal_of_a_bent_fragment_keeps_its_hollow(banana):
    (scanned,) = scanned_goal((Fragment(banana, Pose.identity()),))
    assert iou(scanned.mesh, banana) > 0.9


@pytest.mark.parametrize(
    "mesh", [as_mesh(trimesh.creation.icosphere(4, 0.025)), box_mesh(0.08, 0.03, 0.02)], ids=["round", "square"]
)
def test_a_convex_fragment_is_the_hull_of_its_points(mesh, rng):
    points = sample_surface(mesh, 2000).points + rng.normal(scale=5e-4, size=(2000, 3))
    assert closed_around(points).vertices.tobytes() == hull(points).vertices.tobytes()


def test_points_of_two_bodies_apart_have_one_hull():
    points = sample_surface(box_mesh(0.02, 0.02, 0.02), 500).points
    both = np.concatenate([points, points + np.array([0.1, 0.0, 0.0])])
    assert closed_around(both).volume == pytest.approx(hull(both).volume)
    assert closed_around(np.zeros((50, 3))) is None


def test_a_cut_across_both_arms_of_a_bent_fragment_leaves_three(banana, seen):
    points, normals = seen
    believed = Believed(complete(points, normals, WHOLE), points)
    y = banana.vertices[:, 1]
    plane = Plane(np.array([0.0, 1.0, 0.0]), -0.5 * (y.min() + y.max()))
    three = predict([believed], KnownCut(plane, (0,)))
    assert len(three) == 3
    assert sum(len(each.observed) for each in three) == len(points)
    for each in three:
        lowest, highest = each.mesh.vertices.min(axis=0) - 4e-3, each.mesh.vertices.max(axis=0) + 4e-3
        assert ((each.observed > lowest) & (each.observed < highest)).all()
    parts = divided_by(Found(believed, np.arange(len(points))), plane)
    assert [part.fragment.mesh.volume for part in parts] == [each.mesh.volume for each in three]
    assert np.array_equal(np.sort(np.concatenate([part.members for part in parts])), np.arange(len(points)))
