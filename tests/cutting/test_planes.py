from dataclasses import replace

import numpy as np
import pytest

from cutgrammar.cutting.planes import PlaneNetwork, draws_left, plane_from
from cutgrammar.geometry.plane import Plane
from cutgrammar.grammar.production import Production
from cutgrammar.learning.plane_training import DemonstratedPlane, fit_planes
from cutgrammar.nn.mixture import Mixture
from cutgrammar.nn.mlp import to_bytes
from cutgrammar.perception.feature import z_scale
from cutgrammar.settings import PlaneSettings

QUICK = PlaneSettings(epochs=150, hidden_size=32, n_components=4)
ACROSS, ALONG = Production(0, (1, 1)), Production(1, (2, 2))


def cuts_of(rng, count=60):
    """Type 0 is cut across z in the middle, type 1 across x at +-0.3 of its scale; sizes vary."""
    cuts = []
    for i in range(count):
        scale = rng.uniform(0.02, 0.1)
        z = np.tile(np.append(rng.normal(scale=0.2, size=16), z_scale(scale)), (4, 1))
        production = (ACROSS, ALONG)[i % 2]
        normal = np.array([[0, 0, 1.0], [1.0, 0, 0]][i % 2]) + rng.normal(scale=0.02, size=3)
        offset = (0.0, 0.3 * rng.choice([-1, 1]))[i % 2] + rng.normal(scale=0.02)
        cuts.append(DemonstratedPlane(production, z, Plane(normal / np.linalg.norm(normal), offset * scale), i // 6))
    return cuts


@pytest.fixture(scope="module")
def cuts():
    return cuts_of(np.random.default_rng(2))


@pytest.fixture(scope="module")
def network(cuts):
    return fit_planes(cuts, 3, QUICK, 0)[0]


def drawn(network, production, scale, count=300):
    rng = np.random.default_rng(7)
    z = np.append(np.zeros(16), z_scale(scale))
    return [network.sample(production, z, rng) for _ in range(count)]


def test_planes_look_like_those_demonstrated_for_the_production(network):
    across = np.array([np.abs(plane.to_vector()) for plane in drawn(network, ACROSS, 0.05)])
    assert np.median(across[:, 2]) > 0.97
    assert np.median(across[:, 3]) < 0.05 * 0.1
    along = np.array([np.abs(plane.to_vector()) for plane in drawn(network, ALONG, 0.05)])
    assert np.median(along[:, 0]) > 0.97
    assert np.median(along[:, 3]) == pytest.approx(0.05 * 0.3, rel=0.25)


def test_both_sides_are_cut_although_flips_make_them_equal(network):
    planes = drawn(network, ALONG, 0.05)
    sides = np.array([plane.offset * plane.normal[0] > 0 for plane in planes])
    assert 0.2 < sides.mean() < 0.8


def test_offsets_grow_with_the_fragment(network):
    near, far = (np.median([abs(p.offset) for p in drawn(network, ALONG, scale)]) for scale in (0.03, 0.09))
    assert far / near == pytest.approx(3.0, rel=0.35)


def test_normals_have_length_one(network):
    for plane in drawn(network, ACROSS, 0.05, 50):
        assert np.linalg.norm(plane.normal) == pytest.approx(1.0)


def test_a_production_never_seen_gets_a_plane_too(network):
    production = Production(2, (0, 1, 1))
    mixture = network.mixture(production, np.zeros(17))
    assert mixture.weights.sum() == pytest.approx(1.0)
    assert mixture.means.shape == mixture.sigmas.shape == (4, 4)
    assert mixture.sigmas.min() >= QUICK.min_sigma
    assert np.isfinite(network.sample(production, np.zeros(17), np.random.default_rng(0)).to_vector()).all()


def test_the_network_beats_one_gaussian_on_held_out_trials(cuts):
    found = fit_planes(cuts, 3, QUICK, 0)[1]
    assert len(found.losses) == QUICK.epochs
    assert found.loss < found.gaussian_loss - 1.0


def test_batches_of_cuts_teach_what_all_cuts_teach(cuts):
    some = fit_planes(cuts, 3, replace(QUICK, batch_size=12, epochs=300), 0)[1]
    assert some.loss < some.gaussian_loss - 1.0


def test_first_cuts_of_whole_objects_are_missed_where_no_rule_can_be_learned_and_met_where_it_can(cuts):
    rng = np.random.default_rng(0)
    whole = [replace(cut, is_whole=True) for cut in cuts]
    noise = [replace(cut, plane_C=Plane.through(np.zeros(3), rng.normal(size=3))) for cut in whole]
    learned, not_learned = (fit_planes(some, 3, QUICK, 0)[1] for some in (whole, noise))
    assert learned.missed == learned.missed_held_out == 0.0
    assert not_learned.missed_held_out > 0.5


def test_a_network_that_was_hardly_trained_misses_first_cuts_that_it_has_seen(cuts):
    whole = [replace(cut, is_whole=True) for cut in cuts]
    assert fit_planes(whole, 3, replace(QUICK, epochs=1), 0)[1].missed > 0.3


def test_without_whole_objects_no_first_cut_is_counted(cuts):
    found = fit_planes(cuts, 3, replace(QUICK, epochs=3), 0)[1]
    assert (found.missed, found.missed_held_out) == (None, None)


def test_one_seed_trains_the_same_bits_and_another_does_not(cuts):
    quick = replace(QUICK, epochs=5)
    bits = [fit_planes(cuts, 3, quick, seed)[0].to_bytes() for seed in (0, 0, 1)]
    assert bits[0] == bits[1] != bits[2]


def test_one_trial_alone_is_fitted_without_holding_out(cuts):
    alone = [replace(cut, group=0) for cut in cuts[:4]]
    assert fit_planes(alone, 3, QUICK, 0)[1].losses == ()
    assert fit_planes(alone, 3, replace(QUICK, epochs=3), 0)[0].k == 3


def test_no_cuts_are_an_error():
    with pytest.raises(ValueError, match="at least one cut"):
        fit_planes([], 3, QUICK, 0)[0]


def test_a_network_can_be_read_from_its_bytes(network):
    again = PlaneNetwork.from_bytes(network.to_bytes())
    assert again.to_bytes() == network.to_bytes()
    one, other = (n.sample(ACROSS, np.zeros(17), np.random.default_rng(3)).to_vector() for n in (network, again))
    assert (one == other).all()
    with pytest.raises(ValueError, match="not a network for cutting planes"):
        PlaneNetwork.from_bytes(to_bytes(network.layers))


def test_the_plane_with_the_most_neighbours_is_taken_from_many_draws(rng):
    """Not the densest: a narrow component of a tenth of the weight is denser than the broad one with all the rest."""
    means = np.array([[1.0, 0, 0, 0.3], [0, 1.0, 0, 0]])
    mixture = Mixture(np.array([0.1, 0.9]), means, np.array([[0.001] * 4, [0.1] * 4]))
    most = [plane_from(mixture, 2.0, rng, 64) for _ in range(50)]
    assert min(plane.normal[1] for plane in most) > 0.9
    assert max(abs(plane.offset) for plane in most) < 2.0 * 0.1
    assert any(abs(plane_from(mixture, 2.0, rng).normal[1]) < 0.5 for _ in range(100))


def test_a_plane_and_its_opposite_count_as_one(rng):
    means = np.array([[1.0, 0, 0, 0.3], [-1.0, 0, 0, -0.3], [0, 1.0, 0, 0]])
    mixture = Mixture(np.array([0.4, 0.4, 0.2]), means, np.full((3, 4), 0.02))
    assert all(abs(plane_from(mixture, 1.0, rng, 64).normal[0]) > 0.9 for _ in range(50))


def test_every_refusal_halves_the_draws_down_to_one():
    assert [draws_left(64, refusals) for refusals in (0, 1, 5, 6, 9)] == [64, 32, 2, 1, 1]
