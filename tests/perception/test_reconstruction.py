import numpy as np
import pytest

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.slicing import solid_of
from cutgrammar.nn.mlp import MLP
from cutgrammar.perception.encoder import Decoder
from cutgrammar.perception.feature import normalised
from cutgrammar.perception.occupancy import inside
from measures.reconstruction import overlap_with, reconstructed, reconstruction


def nowhere(points):
    return np.zeros(len(points), dtype=bool)


def everywhere(points):
    return np.ones(len(points), dtype=bool)


def within(mesh):
    return lambda points: inside(mesh, points)


@pytest.fixture(scope="module")
def diamond():
    """A decoder of |x| + |y| + |z| < .8 that ignores z_shape."""
    signs = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
    first = np.concatenate([np.zeros((2, 6)), signs])
    return Decoder(MLP((first, np.full((6, 1), -20.0)), (np.zeros(6), np.array([16.0]))))


def test_the_overlap_of_a_shape_is_1_with_itself_and_0_with_an_empty_region(lump):
    seen = normalised(lump, 32).mesh
    assert overlap_with(seen, within(seen)) == 1.0
    assert overlap_with(seen, nowhere) == 0.0


def test_volume_outside_the_bounding_box_counts_against_a_region(lump):
    seen = normalised(lump, 32).mesh
    assert overlap_with(seen, everywhere) == pytest.approx(seen.volume / 2.5**3, rel=0.05)


@pytest.mark.parametrize("shift", [0.03, 0.1, 0.2])
def test_the_overlap_agrees_with_exact_volumes(lump, shift):
    seen = normalised(lump, 32).mesh
    other = Mesh(0.9 * seen.vertices + [shift, 0.0, 0.5 * shift], seen.faces)
    shared = (solid_of(seen) ^ solid_of(other)).volume()
    exact = shared / (seen.volume + other.volume - shared)
    assert overlap_with(seen, within(other)) == pytest.approx(exact, abs=0.012)


def test_the_reconstructed_surface_is_the_decision_boundary_of_the_decoder(diamond):
    mesh = reconstructed(diamond, np.zeros(2), edge=0.15)
    assert solid_of(mesh).genus() == 0
    assert mesh.volume == pytest.approx(4.0 / 3.0 * 0.8**3, rel=0.06)
    assert np.abs(np.abs(mesh.vertices).sum(axis=1) - 0.8).max() < 0.06
    assert overlap_with(mesh, reconstruction(diamond, np.zeros(2))) > 0.9


def test_a_decoder_of_an_empty_region_has_no_surface():
    empty = Decoder(MLP((np.zeros((5, 1)),), (np.array([-3.0]),)))
    assert reconstructed(empty, np.zeros(2)) is None
    assert not reconstruction(empty, np.zeros(2))(np.zeros((4, 3))).any()


def test_reconstructions_are_better_than_the_mean_shape(training, blocks):
    extractor, trained = training
    own, mean = [], []
    for mesh in blocks(5, seed=8):
        seen, z_shape = normalised(mesh, 32).mesh, extractor(mesh)[:-1]
        own.append(overlap_with(seen, reconstruction(trained.decoder, z_shape)))
        mean.append(overlap_with(seen, reconstruction(trained.decoder, np.zeros(len(z_shape)))))
    assert np.mean(own) > np.mean(mean) + 0.1
