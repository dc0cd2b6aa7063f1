import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.perception.vision.perceive import Perceived, perceive
from cutgrammar.perception.vision.relief import relief
from cutgrammar.perception.vision.seams import MIN_STRENGTH, clearest, find_seam
from simple_shapes import as_mesh

ACROSS = Plane(np.array([np.cos(0.3), np.sin(0.3), 0.0]), -0.012)


@pytest.fixture
def log(rng):
    """What is seen of a round bar on the board, with noise."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    mesh = as_mesh(trimesh.creation.cylinder(0.02, 0.14, sections=48)).moved(Pose(turn, np.array([0.0, 0.0, 0.02])))
    cloud = sample_surface(mesh, 7000)
    seen = (cloud.normals[:, 2] > -0.4) & (cloud.points[:, 2] > 3e-3)
    points, normals = cloud.points[seen], cloud.normals[seen]
    return points + normals * rng.normal(scale=4e-4, size=(len(points), 1)), normals


def grooved(points, normals, plane, part=1.0):
    """The points with a valley 2 mm wide and deep along part of a plane, half of its points missing."""
    valley = (np.abs(plane.distances(points)) < 1e-3) & (points[:, 1] < points[:, 1].min() + 0.04 * part)
    kept = ~valley | (np.arange(len(points)) % 2 == 0)
    return (points - 2e-3 * normals * valley[:, None])[kept], normals[kept]


def test_the_relief_of_a_smooth_surface_is_its_noise_and_that_of_a_valley_its_depth(log):
    points, normals = log
    middle = (np.abs(points[:, 0]) < 0.05) & (points[:, 2] > 0.02)
    assert abs(relief(points, normals)[middle].mean()) < 1e-4
    points, normals = grooved(points, normals, ACROSS)
    middle = (np.abs(ACROSS.distances(points)) < 1e-3) & (points[:, 2] > 0.02)
    assert relief(points, normals)[middle].mean() < -7e-4
    assert np.isnan(relief(points[:10], normals[:10])).all()


def test_a_seam_is_found_where_it_is(log):
    seam = find_seam(*grooved(*log, ACROSS))
    assert seam.strength > MIN_STRENGTH
    assert abs(seam.plane_W.normal @ ACROSS.normal) > np.cos(np.radians(5.0))
    assert abs(seam.plane_W.distances(np.array([[0.012 / np.cos(0.3), 0.0, 0.02]]))[0]) < 2e-3


def test_no_seam_is_found_in_a_whole_food_nor_in_a_dent(log):
    assert find_seam(*log) is None
    assert find_seam(*grooved(*log, ACROSS, part=0.3)) is None
    assert clearest(log[0][:100], log[1][:100]) is None


def test_a_food_with_a_seam_is_perceived_as_two_fragments_unless_their_number_is_known(segmenting, log):
    points, normals = grooved(*log, ACROSS)
    whole = perceive(points, normals, segmenting[0])
    halves = perceive(points, normals, segmenting[0], seams=True)
    assert (len(whole.fragments), len(halves.fragments)) == (1, 2)
    assert sum(half.mesh.volume for half in halves.fragments) == pytest.approx(whole.fragments[0].mesh.volume)
    sides = [np.sign(ACROSS.distances(half.mesh.centroid[None]))[0] for half in halves.fragments]
    assert sorted(sides) == [-1.0, 1.0]
    assert set(halves.labels.tolist()) == {0, 1}
    before = Perceived(np.zeros(0, dtype=np.int64), whole.fragments)
    assert len(perceive(points, normals, segmenting[0], before, seams=True).fragments) == 1
    again = perceive(points, normals, segmenting[0], seams=True)
    for one, other in zip(halves.fragments, again.fragments, strict=True):
        assert one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
