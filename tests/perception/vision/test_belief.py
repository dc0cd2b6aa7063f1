import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.perception.vision.belief import Believed, KnownCut, confirmed, foreseen
from cutgrammar.perception.vision.perceive import UNSEEN, Perceived, perceive
from cutgrammar.perception.vision.segmentation import UNKNOWN

MIDDLE = Plane(np.array([1.0, 0.0, 0.0]), 0.0)
STAYED = Pose.identity()


def known_before(*fragments):
    return Perceived(np.zeros(0, dtype=np.int64), fragments)


@pytest.fixture
def bar(boxes, rng):
    """A bar 8 cm long on the board: its cloud, and what is believed of it."""
    scene = boxes(rng, [(0.0, 0.0)], size=(0.08, 0.03, 0.03), number=2500)
    block = trimesh.creation.box([0.08, 0.03, 0.03])
    mesh = Mesh(block.vertices + np.array([0.0, 0.0, 0.015]), block.faces)
    return scene, Believed(mesh, scene.points)


def test_a_fragment_that_was_cut_is_foreseen_as_two_halves(bar):
    halves = foreseen([bar[1]], KnownCut(MIDDLE, (0,), STAYED))
    assert [half.mesh.volume for half in halves] == pytest.approx([3.6e-5, 3.6e-5])
    assert sum(len(half.seen) for half in halves) == len(bar[1].seen)
    assert (halves[0].seen[:, 0] > 0.0).all()
    assert foreseen([bar[1]], None) == [bar[1]]


def test_a_fragment_that_was_carried_before_the_cut_is_foreseen_where_it_was_set_down(bar):
    carry = Pose(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.array([0.1, 0.0, 0.0]))
    halves = foreseen([bar[1]], KnownCut(Plane(np.array([0.0, 1.0, 0.0]), 0.0), (0,), carry))
    assert np.sort([half.mesh.centroid[1] for half in halves]) == pytest.approx([-0.02, 0.02])
    assert np.mean([half.mesh.centroid[0] for half in halves]) == pytest.approx(0.1)


def test_a_cut_that_misses_what_was_believed_leaves_nothing_foreseen_of_it(bar):
    assert foreseen([bar[1]], KnownCut(Plane(np.array([1.0, 0.0, 0.0]), 1.0), (0,), STAYED)) == []


def test_what_has_moved_by_a_millimetre_is_found_where_it_is_now(bar):
    scene, believed = bar
    there, labels = confirmed([believed], scene.points + np.array([0.001, -0.001, 0.0005]), scene.normals)
    assert (labels == 0).all()
    assert np.allclose(there[0].mesh.centroid, believed.mesh.centroid + np.array([0.001, -0.001, 0.0005]), atol=3e-4)


def test_what_has_gone_is_no_longer_believed(bar):
    scene, believed = bar
    there, labels = confirmed([believed], scene.points + np.array([0.0, 0.05, 0.0]), scene.normals)
    assert there == []
    assert (labels == UNKNOWN).all()


def test_halves_without_a_visible_seam_are_two_fragments_because_the_cut_is_known(segmenting, bar):
    scene, believed = bar
    alone = perceive(scene.points, scene.normals, segmenting[0])
    known = perceive(scene.points, scene.normals, segmenting[0], known_before(believed), KnownCut(MIDDLE, (0,), STAYED))
    assert (len(alone.configuration), len(known.configuration)) == (1, 2)
    assert [fragment.mesh.volume for fragment in known.configuration] == pytest.approx([3.6e-5, 3.6e-5], rel=0.02)
    seam = np.abs(scene.points[:, 0]) > 0.004
    assert len(np.unique(known.labels[seam & (scene.points[:, 0] > 0)])) == 1
    assert len(np.unique(known.labels[seam & (scene.points[:, 0] < 0)])) == 1


def test_a_cluster_that_the_blade_has_gone_through_is_divided_even_where_nothing_was_foreseen(segmenting, bar):
    scene, believed = bar
    gone = Believed(believed.mesh, believed.seen + np.array([0.0, 0.3, 0.0]))
    known = perceive(scene.points, scene.normals, segmenting[0], known_before(gone), KnownCut(MIDDLE, (0,), STAYED))
    assert len(known.configuration) == 2
    assert np.sort([fragment.p_WC[0] for fragment in known.configuration]) == pytest.approx([-0.02, 0.02], abs=2e-3)


def test_a_half_that_has_toppled_is_found_by_the_network_and_the_other_is_kept(segmenting, boxes, bar, rng):
    _, believed = bar
    kept = boxes(rng, [(-0.02, 0.0)], size=(0.04, 0.03, 0.03), number=1200)
    fallen = boxes(rng, [(0.06, 0.0)], size=(0.03, 0.03, 0.04), number=1200)
    points, normals = np.concatenate([kept.points, fallen.points]), np.concatenate([kept.normals, fallen.normals])
    seen = perceive(points, normals, segmenting[0], known_before(believed), KnownCut(MIDDLE, (0,), STAYED))
    assert len(seen.fragments) == 2
    assert seen.fragments[0].mesh.volume == pytest.approx(3.6e-5, rel=0.02)
    assert seen.fragments[1].mesh.centroid == pytest.approx([0.06, 0.0, 0.02], abs=3e-3)


def test_perceiving_repeats_itself_and_places_every_fragment_at_its_centroid(segmenting, boxes, rng):
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


def test_a_fragment_that_is_missing_is_looked_for_until_it_is_found(segmenting, boxes, rng):
    pair = boxes(rng, [(-0.05, 0.0), (0.05, 0.0)])
    first = perceive(pair.points, pair.normals, segmenting[0])
    alone = pair.points[:, 0] < 0.0
    covered = perceive(pair.points[alone], pair.normals[alone], segmenting[0], first)
    assert (len(covered.fragments), covered.missing) == (1, 1)
    again = perceive(pair.points, pair.normals, segmenting[0], covered)
    assert (len(again.fragments), again.missing) == (2, 0)
