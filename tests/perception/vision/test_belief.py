import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.perception.vision.belief import Believed, KnownCut, confirm, predict
from cutgrammar.perception.vision.perceive import UNSEEN, Perceived, perceive
from cutgrammar.perception.vision.segmentation import UNKNOWN
from simple_shapes import box_mesh

MIDPLANE = Plane(np.array([1.0, 0.0, 0.0]), 0.0)


def known_before(*fragments):
    return Perceived(np.zeros(0, dtype=np.int64), fragments)


@pytest.fixture
def bar(boxes, rng):
    """A bar of 8 cm on the board: its cloud and the robot's estimate of it."""
    scene = boxes(rng, [(0.0, 0.0)], size=(0.08, 0.03, 0.03), number=2500)
    mesh = box_mesh(0.08, 0.03, 0.03).moved(Pose(np.eye(3), np.array([0.0, 0.0, 0.015])))
    return scene, Believed(mesh, scene.points)


def test_a_cut_fragment_is_predicted_as_two_halves(bar):
    halves = predict([bar[1]], KnownCut(MIDPLANE, (0,)))
    assert [half.mesh.volume for half in halves] == pytest.approx([3.6e-5, 3.6e-5])
    assert sum(len(half.observed) for half in halves) == len(bar[1].observed)
    assert (halves[0].observed[:, 0] > 0.0).all()
    assert predict([bar[1]], None) == [bar[1]]


def test_a_fragment_moved_before_the_cut_is_predicted_at_its_new_place(bar):
    carry = Pose(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.array([0.1, 0.0, 0.0]))
    halves = predict([bar[1]], KnownCut(Plane(np.array([0.0, 1.0, 0.0]), 0.0), (0,), ((0, carry),)))
    assert np.sort([half.mesh.centroid[1] for half in halves]) == pytest.approx([-0.02, 0.02])
    assert np.mean([half.mesh.centroid[0] for half in halves]) == pytest.approx(0.1)


@pytest.mark.parametrize("beside", [-0.0405, 0.0405])
def test_a_cut_that_misses_the_estimate_still_divides_it_at_its_end(bar, beside):
    halves = predict([bar[1]], KnownCut(Plane(np.array([1.0, 0.0, 0.0]), -beside), (0,)))
    assert np.sort([half.mesh.volume for half in halves]) == pytest.approx([0.05 * 7.2e-5, 0.95 * 7.2e-5])
    thin = min(halves, key=lambda half: half.mesh.volume)
    assert thin.mesh.centroid[0] == pytest.approx(np.sign(beside) * 0.038)


def test_a_fragment_that_moved_by_a_millimetre_is_confirmed_at_its_new_place(bar):
    scene, believed = bar
    found, labels = confirm([believed], scene.points + np.array([0.001, -0.001, 0.0005]), scene.normals)
    assert (labels == 0).all()
    assert np.allclose(found[0].mesh.centroid, believed.mesh.centroid + np.array([0.001, -0.001, 0.0005]), atol=3e-4)


def test_a_fragment_that_is_gone_is_not_confirmed(bar):
    scene, believed = bar
    found, labels = confirm([believed], scene.points + np.array([0.0, 0.05, 0.0]), scene.normals)
    assert found == {}
    assert (labels == UNKNOWN).all()


def test_a_known_cut_separates_halves_without_a_visible_seam(segmenting, bar):
    scene, believed = bar
    alone = perceive(scene.points, scene.normals, segmenting[0])
    known = perceive(scene.points, scene.normals, segmenting[0], known_before(believed), KnownCut(MIDPLANE, (0,)))
    assert (len(alone.configuration), len(known.configuration)) == (1, 2)
    assert [fragment.mesh.volume for fragment in known.configuration] == pytest.approx([3.6e-5, 3.6e-5], rel=0.02)
    seam = np.abs(scene.points[:, 0]) > 0.004
    assert len(np.unique(known.labels[seam & (scene.points[:, 0] > 0)])) == 1
    assert len(np.unique(known.labels[seam & (scene.points[:, 0] < 0)])) == 1


def test_a_new_cluster_is_divided_by_the_plane_of_the_cut(segmenting, bar):
    scene, believed = bar
    gone = Believed(believed.mesh, believed.observed + np.array([0.0, 0.3, 0.0]))
    known = perceive(scene.points, scene.normals, segmenting[0], known_before(gone), KnownCut(MIDPLANE, (0,)))
    assert len(known.configuration) == 2
    assert np.sort([fragment.p_WC[0] for fragment in known.configuration]) == pytest.approx([-0.02, 0.02], abs=2e-3)


def test_a_half_that_fell_over_is_segmented_anew_and_the_other_is_kept(segmenting, boxes, bar, rng):
    _, believed = bar
    kept = boxes(rng, [(-0.02, 0.0)], size=(0.04, 0.03, 0.03), number=1200)
    fallen = boxes(rng, [(0.06, 0.0)], size=(0.03, 0.03, 0.04), number=1200)
    points, normals = np.concatenate([kept.points, fallen.points]), np.concatenate([kept.normals, fallen.normals])
    seen = perceive(points, normals, segmenting[0], known_before(believed), KnownCut(MIDPLANE, (0,)))
    assert len(seen.fragments) == 2
    assert seen.fragments[0].mesh.volume == pytest.approx(3.6e-5, rel=0.02)
    assert seen.fragments[1].mesh.centroid == pytest.approx([0.06, 0.0, 0.02], abs=3e-3)


def test_perception_is_deterministic_and_fragment_frames_are_at_centroids(segmenting, boxes, rng):
    scene = boxes(rng, [(-0.05, 0.0), (0.05, 0.0)])
    first, again = (perceive(scene.points, scene.normals, segmenting[0]) for _ in range(2))
    assert np.array_equal(first.labels, again.labels)
    for a, b in zip(first.configuration, again.configuration, strict=True):
        assert a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes()
        assert np.allclose(a.mesh.centroid, 0.0, atol=1e-9)


def test_nothing_is_perceived_in_an_empty_cloud(segmenting):
    seen = perceive(np.zeros((0, 3)), np.zeros((0, 3)), segmenting[0])
    assert seen.configuration == ()
    flat = np.column_stack([np.linspace(0.0, 0.01, 8), np.zeros(8), np.full(8, 0.01)])
    lone = perceive(flat, np.tile([0.0, 0.0, 1.0], (8, 1)), segmenting[0])
    assert lone.configuration == ()
    assert (lone.labels == UNSEEN).all()


def test_a_hidden_fragment_is_kept_where_it_was_until_it_is_found(segmenting, boxes, rng):
    pair = boxes(rng, [(-0.05, 0.0), (0.05, 0.0)])
    first = perceive(pair.points, pair.normals, segmenting[0])
    alone = pair.points[:, 0] < 0.0
    covered = perceive(pair.points[alone], pair.normals[alone], segmenting[0], first)
    assert (len(covered.fragments), covered.missing) == (2, 0)
    assert set(covered.labels.tolist()) == {0}
    assert covered.fragments[1].mesh.centroid == pytest.approx([0.05, 0.0, 0.015], abs=3e-3)
    again = perceive(pair.points, pair.normals, segmenting[0], covered)
    assert (len(again.fragments), again.missing) == (2, 0)
    assert len(set(again.labels.tolist())) == 2


def test_every_fragment_is_moved_as_the_robot_moved_it(bar):
    by = np.array([[0.0, 0.3, 0.0], [0.1, 0.0, 0.0]])
    aside, carry = (Pose(np.eye(3), each) for each in by)
    beside, cut = both = [bar[1].moved(Pose(np.eye(3), np.array([0.0, 0.1, 0.0]))), bar[1]]
    after = predict(both, KnownCut(MIDPLANE.transformed(carry), (1,), ((0, aside), (1, carry))))
    assert len(after) == 3
    assert np.allclose(after[0].observed, beside.observed + by[0])
    low, high = cut.observed.min(axis=0), cut.observed.max(axis=0)
    halves = np.concatenate([half.observed for half in after[1:]])
    assert np.allclose([halves.min(axis=0), halves.max(axis=0)], [low + by[1], high + by[1]])
