"""Small training sets for the tests of perception."""

import numpy as np
import pytest

from cutgrammar.learning.encoder_training import fit_features
from cutgrammar.learning.segmentation_training import fit_segmentation
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.settings import FeatureSettings, VisionSettings
from simple_shapes import box_mesh


def _blocks(count, seed=3):
    rng = np.random.default_rng(seed)
    return [box_mesh(*rng.uniform(0.01, 0.06, size=3)) for _ in range(count)]


@pytest.fixture(scope="session")
def quick():
    """Settings of an encoder that trains in a second or two."""
    return FeatureSettings(n_points=1024, epochs=80, hidden_size=32)


@pytest.fixture(scope="session")
def blocks():
    """Makes blocks of random size."""
    return _blocks


@pytest.fixture(scope="session")
def training(quick):
    """A feature extractor trained on twelve blocks, and its training report."""
    return fit_features(_blocks(12), quick, np.random.default_rng(4))


@pytest.fixture
def extractor(training):
    return training[0]


def _boxes(rng, centres, size=(0.03, 0.03, 0.03), number=500, underside=False):
    clouds = []
    for centre in centres:
        axis, end = rng.integers(3, size=number), rng.choice([-1.0, 1.0], size=number)
        if not underside:
            end[axis == 2] = 1.0
        points = rng.uniform(-0.5, 0.5, size=(number, 3))
        normals = np.zeros((number, 3))
        points[np.arange(number), axis] = 0.5 * end
        normals[np.arange(number), axis] = end
        clouds.append((points * size + [*centre, size[2] / 2.0], normals))
    points, normals = (np.concatenate(parts) for parts in zip(*clouds, strict=True))
    return LabelledCloud(points, normals, np.repeat(np.arange(len(clouds)), number))


@pytest.fixture(scope="session")
def boxes():
    """Makes a cloud of boxes on the board, centred at each (x, y) [m]; by default without undersides."""
    return _boxes


@pytest.fixture(scope="session")
def box_scenes():
    """Six scenes of three boxes side by side."""
    rng = np.random.default_rng(5)
    return [_boxes(rng, [(0.04 * i, rng.uniform(-0.01, 0.01)) for i in range(3)], number=300) for _ in range(6)]


@pytest.fixture(scope="session")
def tiny_vision():
    """Settings of a segmentation that trains in a second."""
    return VisionSettings(epochs=6, hidden_size=8, n_message_rounds=1, learning_rate=1e-2)


@pytest.fixture(scope="session")
def segmenting(box_scenes, tiny_vision):
    """A small segmentation network trained on boxes, and its training report."""
    return fit_segmentation(box_scenes, tiny_vision, np.random.default_rng(6))
