import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.learning.segmentation_training import fit_segmentation
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.vision.agglomeration import agglomerate
from cutgrammar.perception.vision.neighbourhoods import EDGE_FEATURES, POINT_FEATURES, describe, thin
from cutgrammar.perception.vision.segment_iou import per_fragment_iou
from cutgrammar.perception.vision.segmentation import UNKNOWN, Segmentation

SEPARATE = ((-0.06, 0.0), (0.0, 0.01), (0.07, -0.02))


def equal_up_to_labels(a, b):
    return bool((per_fragment_iou(a, b) == 1.0).all()) and len(np.unique(a)) == len(np.unique(b))


def test_separate_boxes_are_separate_fragments(segmenting, boxes, rng):
    scene = boxes(rng, SEPARATE)
    labels = segmenting[0](scene.points, scene.normals)
    assert equal_up_to_labels(scene.owners, labels)
    assert sorted(set(labels.tolist())) == [0, 1, 2]


def test_the_segmentation_does_not_depend_on_the_order_of_the_points(segmenting, boxes, rng):
    scene = boxes(rng, [(0.0, 0.0), (0.0305, 0.004), (0.02, 0.0345)])
    order = rng.permutation(len(scene.points))
    labels = segmenting[0](scene.points, scene.normals)
    assert np.array_equal(segmenting[0](scene.points[order], scene.normals[order]), labels[order])


def test_the_segmentation_does_not_depend_on_rotation_and_shift_on_the_board(segmenting, boxes, rng):
    scene = boxes(rng, SEPARATE)
    turn = Rotation.from_euler("z", 0.7).as_matrix()
    moved = segmenting[0](scene.points @ turn.T + [0.031, -0.007, 0.0], scene.normals @ turn.T)
    assert equal_up_to_labels(segmenting[0](scene.points, scene.normals), moved)


def test_the_features_of_points_do_not_depend_on_rotation_and_shift_on_the_board(boxes, rng):
    scene = boxes(rng, SEPARATE)
    turn = Rotation.from_euler("z", 0.7).as_matrix()
    before = describe(scene.points, scene.normals)
    after = describe(scene.points @ turn.T + [0.3, -0.2, 0.0], scene.normals @ turn.T)
    assert np.array_equal(before.near, after.near)
    assert np.allclose(before.points, after.points, atol=1e-6)
    assert np.allclose(before.near_edges, after.near_edges, atol=1e-6)


def test_two_known_fragments_stay_separate_without_a_visible_seam(segmenting, boxes, rng):
    scene = boxes(rng, [(0.0, 0.0)], size=(0.06, 0.03, 0.03), number=1500)
    believed = np.where(scene.points[:, 0] > 0.0, 7, 3)
    believed[np.abs(scene.points[:, 0]) < 0.004] = UNKNOWN
    labels = segmenting[0](scene.points, scene.normals, believed)
    assert np.array_equal(labels[believed == 3], np.zeros((believed == 3).sum()))
    assert np.array_equal(labels[believed == 7], np.ones((believed == 7).sum()))
    assert labels.max() == 1


def test_a_known_fragment_stays_one_fragment_across_a_gap(segmenting, boxes, rng):
    scene = boxes(rng, SEPARATE)
    labels = segmenting[0](scene.points, scene.normals, np.where(scene.owners == 2, UNKNOWN, 0))
    assert np.array_equal(labels, np.where(scene.owners == 2, 1, 0))


def test_training_is_deterministic_and_reduces_the_loss(segmenting, box_scenes, tiny_vision):
    network, training = segmenting
    again, report = fit_segmentation(box_scenes, tiny_vision, np.random.default_rng(6))
    assert again.to_bytes() == network.to_bytes()
    assert report.losses == training.losses
    assert training.losses[-1] < 0.7 * training.losses[0]


def test_held_out_scenes_select_the_threshold(box_scenes, tiny_vision):
    _, training = fit_segmentation(box_scenes * 3, tiny_vision, np.random.default_rng(6))
    assert len(training.held_out_losses) == tiny_vision.epochs
    assert training.held_out_iou > 0.9


def test_a_network_survives_serialisation_and_pickling(segmenting, boxes, rng):
    network, scene = segmenting[0], boxes(rng, SEPARATE)
    for copy in (Segmentation.from_bytes(network.to_bytes()), pickle.loads(pickle.dumps(network))):
        assert copy.to_bytes() == network.to_bytes()
        assert np.array_equal(copy(scene.points, scene.normals), network(scene.points, scene.normals))


def test_invalid_networks_and_inputs_are_refused(segmenting, extractor):
    with pytest.raises(ValueError, match=r"not a segmentation \(the network lacks describing.0.weight\)"):
        Segmentation.from_bytes(extractor.to_bytes())
    with pytest.raises(ValueError, match="must be between 0 and 1"):
        Segmentation(segmenting[0].describing, segmenting[0].rounds, segmenting[0].judging, 1.5)
    with pytest.raises(ValueError, match="1 points are too few"):
        segmenting[0](np.zeros((1, 3)), np.ones((1, 3)))
    with pytest.raises(ValueError, match="at least one scene"):
        fit_segmentation([], None, np.random.default_rng(0))


def test_a_cloud_of_a_few_points_is_one_fragment(segmenting):
    points = np.array([[0.0, 0.0, 0.01], [0.005, 0.0, 0.01], [0.0, 0.005, 0.01]])
    assert segmenting[0](points, np.tile([0.0, 0.0, 1.0], (3, 1))).tolist() == [0, 0, 0]


def test_one_wrong_edge_along_a_seam_is_outvoted():
    edges = np.array([[0, 1], [2, 3], [0, 2], [1, 3]])
    labels = agglomerate(4, edges, np.array([0.9, 0.9, 0.8, 0.1]), 0.5)
    assert labels.tolist() == [0, 0, 1, 1]
    assert agglomerate(4, edges, np.array([0.9, 0.9, 0.8, 0.4]), 0.5).tolist() == [0, 0, 0, 0]


def test_clusters_of_different_kinds_are_never_merged():
    edges = np.array([[0, 1], [1, 2]])
    assert agglomerate(3, edges, np.ones(2), 0.5, np.array([0, -1, 1])).tolist() == [0, 0, 1]


def test_thinning_takes_the_mean_of_each_cell_independent_of_the_order_of_points(rng):
    points, normals = rng.uniform(0.0, 0.02, size=(300, 3)), rng.normal(size=(300, 3))
    order = rng.permutation(300)
    thinned, shuffled = thin(points, normals), thin(points[order], normals[order])
    assert thinned.points.tobytes() == shuffled.points.tobytes()
    assert np.array_equal(thinned.cell_of[order], shuffled.cell_of)
    assert np.allclose(thinned.points[4], points[thinned.cell_of == 4].mean(axis=0))


def test_iou_is_computed_per_fragment_and_is_zero_without_a_label():
    owners, labels = np.array([0, 0, 0, 1, 1, 2, -1]), np.array([5, 5, 8, 8, 8, 8, 8])
    assert per_fragment_iou(owners, labels).tolist() == [2 / 3, 2 / 4, 0.0]
    assert per_fragment_iou(owners, owners).tolist() == [1.0, 1.0, 1.0]
    assert per_fragment_iou(owners, np.full(7, -1)).tolist() == [0.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="no point belongs to a fragment"):
        per_fragment_iou(np.array([-1]), np.array([0]))


def test_the_threshold_adapts_to_the_expected_number_of_clusters(boxes, rng):
    judging = np.zeros((2 + EDGE_FEATURES, 1))
    judging[2] = -8.0  # longer edges are less likely to connect
    describing = MLP((np.zeros((POINT_FEATURES, 1)),), (np.zeros(1),))
    network = Segmentation(describing, (), MLP((judging,), (np.full(1, 8.0),)), 0.02)
    scene = boxes(rng, [(0.0, 0.0), (0.036, 0.0), (0.072, 0.0)], number=1500)
    assert network(scene.points, scene.normals).max() == 0
    assert equal_up_to_labels(network(scene.points, scene.normals, expected=3), scene.owners)
    believed = np.where(scene.owners == 1, 5, UNKNOWN)
    labels = network(scene.points, scene.normals, believed, expected=2)
    assert (labels[scene.owners == 1] == 0).all()
    assert equal_up_to_labels(labels, scene.owners)
