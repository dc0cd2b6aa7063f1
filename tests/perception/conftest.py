"""Small training sets that several tests of perception share."""

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.perception.encoder_training import fit_features
from cutgrammar.settings import FeatureSettings


def _block(x, y, z):
    box = trimesh.creation.box([x, y, z])
    return Mesh(box.vertices, box.faces)


def _blocks(count, seed=3):
    rng = np.random.default_rng(seed)
    return [_block(*rng.uniform(0.01, 0.06, size=3)) for _ in range(count)]


@pytest.fixture(scope="session")
def quick():
    """Settings of an encoder that trains in a second or two."""
    return FeatureSettings(points=1024, epochs=80, hidden=32)


@pytest.fixture(scope="session")
def blocks():
    """Makes blocks of random size."""
    return _blocks


@pytest.fixture(scope="session")
def training(quick):
    """An extractor and what its training told, from twelve blocks."""
    return fit_features(_blocks(12), quick, np.random.default_rng(4))


@pytest.fixture
def extractor(training):
    return training[0]
