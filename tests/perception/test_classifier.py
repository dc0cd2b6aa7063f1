from dataclasses import replace

import numpy as np
import pytest

from cutgrammar.learning.classifier_training import fit_classifier
from cutgrammar.nn.mlp import to_bytes
from cutgrammar.perception.classifier import FLOOR, TypeClassifier
from cutgrammar.settings import ClassifierSettings

QUICK = ClassifierSettings(epochs=40, hidden_size=16, learning_rate=1e-2, n_folds=2)


@pytest.fixture(scope="module")
def corpus():
    """Three types in ten trials; the fourth type never occurs, and the scales of the entries of z differ widely."""
    rng = np.random.default_rng(5)
    types = rng.integers(3, size=150)
    centres = rng.normal(size=(4, 17))
    z = (centres[types] + 0.4 * rng.normal(size=(150, 17))) * np.geomspace(0.01, 100, 17)
    return z, types, rng.integers(10, size=150)


@pytest.fixture(scope="module")
def classifier(corpus):
    z, types, groups = corpus
    return fit_classifier(z, types, 4, QUICK, 0, groups)[0]


def test_probabilities_sum_to_one_for_any_feature(classifier, corpus):
    for z in (corpus[0], 1e6 * corpus[0], np.zeros((3, 17))):
        log_p = classifier.log_probabilities(z)
        assert np.isfinite(log_p).all()
        assert np.exp(log_p).sum(axis=1) == pytest.approx(np.ones(len(z)))


def test_an_unseen_type_has_the_minimum_probability(classifier, corpus):
    assert np.exp(classifier.log_probabilities(corpus[0])[:, 3]) == pytest.approx(np.full(150, FLOOR / 4))


def test_well_separated_types_are_classified_correctly(classifier, corpus):
    assert (classifier.log_probabilities(corpus[0]).argmax(axis=1) == corpus[1]).mean() > 0.98


def test_a_row_gives_identical_results_alone_and_in_a_batch(classifier, corpus):
    together = classifier.log_probabilities(corpus[0])
    assert (together == np.concatenate([classifier.log_probabilities(z[None]) for z in corpus[0]])).all()


def test_training_is_deterministic_for_a_seed(corpus):
    z, types, groups = corpus
    fits = [fit_classifier(z, types, 4, QUICK, seed, groups)[0].to_bytes() for seed in (0, 0, 1)]
    assert fits[0] == fits[1] != fits[2]


def test_confidence_is_low_for_random_types(corpus):
    z, _, groups = corpus
    rng = np.random.default_rng(0)
    types = rng.integers(3, size=len(z))  # independent of z
    found = fit_classifier(z, types, 3, replace(QUICK, epochs=200), 0, groups)[0]
    confidence = np.exp(found.log_probabilities(z + 0.01 * rng.normal(size=z.shape))).max(axis=1).mean()
    assert confidence < 0.6


def test_cross_validation_reports_held_out_quality(corpus):
    z, types, groups = corpus
    found = fit_classifier(z, types, 4, QUICK, 0, groups)[1]
    assert len(found.losses) == QUICK.epochs
    assert found.accuracy > 0.9
    assert found.log_likelihood > -0.4


def test_a_type_of_a_single_trial_does_not_distort_the_calibration(corpus):
    z, types, groups = corpus
    lone = np.where(groups == 3, 3, types)
    found = fit_classifier(z, lone, 4, QUICK, 0, groups)[1]
    assert np.isfinite(found.log_likelihood)
    assert found.temperature < 5
    assert found.unseen == pytest.approx((groups == 3).mean())
    assert found.log_likelihood > -0.4  # of the other types


def test_a_single_trial_is_fitted_without_holding_out(corpus):
    z, types, _ = corpus
    one = np.zeros(len(z), dtype=int)
    assert fit_classifier(z, types, 4, QUICK, 0, one)[1].accuracy is None
    assert fit_classifier(z, types, 4, QUICK, 0, one)[0].temperature == 1.0


def test_one_type_is_certain(corpus):
    z, types, groups = corpus
    found = fit_classifier(z, np.zeros_like(types), 1, QUICK, 0, groups)[0]
    assert found.log_probabilities(z) == pytest.approx(np.zeros((len(z), 1)), abs=1e-6)


def test_types_out_of_range_and_empty_data_are_refused(corpus):
    z, types, _ = corpus
    with pytest.raises(ValueError, match="outside 0 to 1"):
        fit_classifier(z, types, 2, QUICK, 0)[0]
    with pytest.raises(ValueError, match="at least one"):
        fit_classifier(z[:0], types[:0], 2, QUICK, 0)[0]


def test_a_classifier_survives_serialisation(classifier, corpus):
    again = TypeClassifier.from_bytes(classifier.to_bytes())
    assert (again.log_probabilities(corpus[0]) == classifier.log_probabilities(corpus[0])).all()
    with pytest.raises(ValueError, match="not a classifier"):
        TypeClassifier.from_bytes(to_bytes(classifier.layers))
