"""Known cases, laws and determinism of the statistics."""

import itertools

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, permutation_test

from cutgrammar.results.statistics import (
    bootstrap_band,
    bootstrap_interval,
    holm,
    paired_test,
    per_unit,
    share_of_wins,
    shares_above,
    std_over_runs,
)


def test_trials_are_averaged_over_their_runs():
    units, means = per_unit([1.0, 3.0, 10.0], [7, 7, 2])
    assert units.tolist() == [2, 7]
    assert means.tolist() == [10.0, 2.0]


def test_the_spread_over_runs_is_the_sample_deviation_of_their_means():
    assert std_over_runs([0.0, 1.0, 1.0, 2.0], [0, 0, 1, 1]) == pytest.approx(np.std([0.5, 1.5], ddof=1))
    assert std_over_runs([0.2, 0.4], [3, 3]) is None


def test_unknown_scores_are_refused():
    with pytest.raises(ValueError, match="left out, not given as NaN"):
        per_unit([1.0, float("nan")], [0, 1])
    with pytest.raises(ValueError, match="two rows of one length"):
        per_unit([], [])


def test_the_interval_of_equal_scores_is_a_point_and_that_of_a_single_trial_unknown(rng):
    assert bootstrap_interval([0.5] * 6, [0] * 6, rng) == (0.5, 0.5)
    assert bootstrap_interval([0.5], [0], rng) is None
    assert bootstrap_interval([0.5, 0.7], [0, 1], rng) is None
    assert bootstrap_interval([0.5, 0.7, 0.6], [0, 0, 1], rng) is None


def test_the_interval_of_many_normal_scores_is_that_of_the_mean():
    values = np.random.default_rng(1).normal(2.0, 1.0, 400)
    low, high = bootstrap_interval(values, np.zeros(400, int), np.random.default_rng(2))
    half = 1.96 * values.std() / 20.0
    assert low == pytest.approx(values.mean() - half, abs=0.01)
    assert high == pytest.approx(values.mean() + half, abs=0.01)


def test_differences_between_strata_do_not_widen_the_interval(rng):
    values = np.r_[np.zeros(20), np.ones(20)]
    assert bootstrap_interval(values, np.repeat([0, 1], 20), rng) == (0.5, 0.5)
    low, high = bootstrap_interval(values, np.zeros(40), rng)
    assert high - low > 0.2


def test_the_interval_holds_the_truth_about_as_often_as_it_says():
    draws = np.random.default_rng(5)
    hits = 0
    for _ in range(200):
        low, high = bootstrap_interval(draws.normal(0.3, 1.0, 40), np.zeros(40), draws, n_resamples=400)
        hits += low <= 0.3 <= high
    assert 0.88 <= hits / 200 <= 0.99


def test_few_differences_are_enumerated_exactly(rng):
    d = np.array([0.3, -0.1, 0.25, 0.05, 0.4])
    sums = [abs(np.dot(signs, d)) for signs in itertools.product([1, -1], repeat=5)]
    assert paired_test(d, rng) == np.mean(np.array(sums) >= abs(d.sum()) - 1e-9)
    assert paired_test([1.0, 1.0, 1.0], rng) == 0.25
    assert paired_test([0.5], rng) is None
    assert paired_test([0.0, 0.0, 0.0], rng) == 1.0


def test_drawn_and_enumerated_tests_agree_with_an_independent_implementation():
    d = np.random.default_rng(3).normal(0.25, 1.0, 40)
    ours = paired_test(d, np.random.default_rng(4))
    theirs = permutation_test(
        (d, np.zeros(40)), lambda a, b: np.mean(a - b), permutation_type="samples", n_resamples=10_000, rng=1
    )
    assert ours == pytest.approx(theirs.pvalue, abs=0.02)
    assert paired_test(-d, np.random.default_rng(4)) == ours


def test_a_clear_difference_is_significant_and_never_certain(rng):
    p = paired_test(np.full(40, 0.2), rng)
    assert 0.0 < p < 1e-3


def test_under_no_difference_p_values_are_uniform():
    draws = np.random.default_rng(6)
    p = np.array([paired_test(draws.normal(size=20), draws, n_resamples=300) for _ in range(300)])
    assert np.mean(p <= 0.05) < 0.10
    assert 0.4 < np.mean(p) < 0.6


def test_holm_corrects_in_order_and_leaves_out_the_unknown():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.01, None, 0.5]) == [0.02, None, 0.5]
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_the_same_stream_gives_the_same_bits(rng):
    values, strata = rng.uniform(size=60), rng.integers(3, size=60)
    first = bootstrap_interval(values, strata, np.random.default_rng(9))
    assert bootstrap_interval(values, strata, np.random.default_rng(9)) == first
    assert paired_test(values, np.random.default_rng(9)) == paired_test(values, np.random.default_rng(9))


def test_ten_thousand_trials_have_an_interval(rng):
    values = rng.uniform(size=10_000)
    low, high = bootstrap_interval(values, np.arange(10_000) % 6, rng, n_resamples=500)
    assert low < values.mean() < high


def test_the_balanced_interval_is_that_of_the_mean_of_the_strata(rng):
    values, strata = np.r_[np.zeros(30), np.ones(10)], np.repeat([0, 1], [30, 10])
    assert bootstrap_interval(values, strata, rng) == (0.25, 0.25)
    assert bootstrap_interval(values, strata, rng, balanced=True) == pytest.approx((0.5, 0.5))
    spread = np.r_[np.random.default_rng(1).normal(0, 1, 400), np.random.default_rng(2).normal(1, 1, 100)]
    low, high = bootstrap_interval(spread, np.repeat([0, 1], [400, 100]), rng, balanced=True)
    half = 1.96 * 0.5 * np.sqrt(spread[:400].var() / 400 + spread[400:].var() / 100)
    middle = 0.5 * (spread[:400].mean() + spread[400:].mean())
    assert (low, high) == pytest.approx((middle - half, middle + half), abs=0.01)


def test_wins_are_those_of_an_independent_implementation(rng):
    for _ in range(20):
        ours, theirs = rng.integers(6, size=5) / 5, rng.integers(6, size=4) / 5
        u = mannwhitneyu(ours, theirs).statistic
        assert share_of_wins(ours, theirs) == pytest.approx(u / 20)
        assert share_of_wins(ours, theirs) + share_of_wins(theirs, ours) == pytest.approx(1.0)
    assert share_of_wins([0.5], [0.5]) == 0.5
    with pytest.raises(ValueError, match="both methods need at least one"):
        share_of_wins([0.5], [])


def test_shares_above_are_those_of_runs_strictly_above_and_fall():
    assert shares_above([0.1, 0.5, 0.5], [0.0, 0.1, 0.5, 0.9]) == pytest.approx([1, 2 / 3, 0, 0])
    shares = shares_above(np.random.default_rng(1).uniform(size=50), np.linspace(0, 1, 11))
    assert (np.diff(shares) <= 0).all()
    assert (shares[0], shares[-1]) == (1.0, 0.0)
    for wrong in ([], [0.5, np.nan]):
        with pytest.raises(ValueError, match="no runs|finite"):
            shares_above(wrong, [0.5])


def test_the_band_of_a_single_column_is_the_interval_of_its_mean(rng):
    values, strata = rng.uniform(size=60), rng.integers(3, size=60)
    low, high = bootstrap_band(values[:, None], strata, np.random.default_rng(3))
    assert (low[0], high[0]) == pytest.approx(bootstrap_interval(values, strata, np.random.default_rng(4)), abs=0.01)


def test_the_band_falls_with_its_profile_and_holds_it():
    draws = np.random.default_rng(7)
    shares = np.array([shares_above(draws.uniform(size=5), np.linspace(0, 1, 21)) for _ in range(60)])
    low, high = bootstrap_band(shares, np.arange(60) % 6, draws, n_resamples=500)
    assert (np.diff(low) <= 0).all()
    assert (np.diff(high) <= 0).all()
    assert (low <= shares.mean(axis=0)).all()
    assert (shares.mean(axis=0) <= high).all()


def test_a_stratum_with_one_unit_has_no_band_and_strata_must_fit(rng):
    assert bootstrap_band([[1.0], [0.5], [0.2]], [0, 0, 1], rng) is None
    with pytest.raises(ValueError, match="one row and one stratum a unit"):
        bootstrap_band([[1.0], [0.5]], [0], rng)
