"""Krippendorff's alpha against the published worked example and a published implementation."""

import numpy as np
import pytest

from cutgrammar.results.rater_agreement import ordinal_alpha

NA = np.nan
WORKED_EXAMPLE = [
    [1, 2, 3, 3, 2, 1, 4, 1, 2, NA, NA, NA],
    [1, 2, 3, 3, 2, 2, 4, 1, 2, 5, NA, 3],
    [NA, 3, 3, 3, 2, 3, 4, 2, 2, 5, 1, NA],
    [1, 2, 3, 3, 2, 4, 4, 1, 2, 5, 1, NA],
]
"""K. Krippendorff, "Computing Krippendorff's Alpha-Reliability", 2011, section D: four raters, twelve units."""


def counts(ratings):
    return (np.array(ratings).T[:, :, None] == np.arange(1, 6)).sum(axis=1)


def test_the_published_example_has_its_published_alpha():
    assert ordinal_alpha(counts(WORKED_EXAMPLE)) == pytest.approx(0.815, abs=5e-4)


def test_three_raters_have_the_alpha_of_a_published_implementation():
    krippendorff = pytest.importorskip("krippendorff")
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = rng.integers(1, 6, 25)
        ratings = np.clip(truth + rng.integers(-1, 2, (3, 25)), 1, 5).astype(float)
        ratings[rng.random(ratings.shape) < 0.3] = NA
        expected = krippendorff.alpha(ratings, value_domain=[1, 2, 3, 4, 5], level_of_measurement="ordinal")
        assert ordinal_alpha(counts(ratings)) == pytest.approx(expected, abs=1e-12)


def test_perfect_agreement_is_one_and_the_order_of_units_and_raters_does_not_matter():
    assert ordinal_alpha(counts([[1, 3, 5, 2], [1, 3, 5, 2]])) == pytest.approx(1.0)
    example = np.array(WORKED_EXAMPLE)
    again = example[::-1, np.random.default_rng(0).permutation(12)]
    assert ordinal_alpha(counts(again)) == pytest.approx(ordinal_alpha(counts(example)), abs=1e-12)


def test_a_larger_disagreement_lowers_alpha_more():
    near, far = [[1, 2, 4, 5, 1], [1, 2, 4, 5, 2]], [[1, 2, 4, 5, 1], [1, 2, 4, 5, 5]]
    assert ordinal_alpha(counts(far)) < ordinal_alpha(counts(near)) < 1.0


def test_alpha_is_unknown_without_pairs_or_without_variation():
    assert ordinal_alpha(counts([[1, NA], [NA, 4]])) is None
    assert ordinal_alpha(counts([[3, 3], [3, 3]])) is None
    with pytest.raises(ValueError, match="table of numbers"):
        ordinal_alpha([1, 2])
