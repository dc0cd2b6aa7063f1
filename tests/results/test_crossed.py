"""Means over crossed trials and models: known cases, and the level of the test by simulation."""

import numpy as np
import pytest
from scipy import stats

from cutgrammar.results.crossed import Crossing, crossed_mean
from cutgrammar.results.samples import ANY_MODEL, interval_of_mean, n_models, paired, paired_difference
from cutgrammar.results.statistics import MAX_RESAMPLED, paired_test


def crossing(values, setups=None):
    values = np.asarray(values, dtype=float)
    return Crossing(values, np.zeros(len(values), int) if setups is None else np.asarray(setups))


def test_models_that_do_not_differ_leave_the_t_test_over_trials():
    scores = np.random.default_rng(1).normal(0.1, 0.2, 30)
    found = crossed_mean([crossing(np.repeat(scores[:, None], 5, axis=1))])
    assert found.p_value() == pytest.approx(stats.ttest_1samp(scores, 0.0).pvalue)
    assert found.degrees == pytest.approx(29)


def test_trials_that_do_not_differ_leave_the_t_test_over_models():
    scores = np.random.default_rng(2).normal(0.1, 0.2, 5)
    found = crossed_mean([crossing(np.repeat(scores[None], 30, axis=0))])
    assert found.p_value() == pytest.approx(stats.ttest_1samp(scores, 0.0).pvalue)
    assert found.degrees == pytest.approx(4)
    ends = stats.ttest_1samp(scores, 0.0).confidence_interval()
    assert found.interval() == (pytest.approx(ends.low), pytest.approx(ends.high))


def test_setups_are_no_source_of_chance_and_count_equally_where_asked():
    values = np.repeat(np.r_[np.zeros(2), np.ones(6)][:, None], 3, axis=1)
    setups = [0, 0, 1, 1, 1, 1, 1, 1]
    assert crossed_mean([crossing(values, setups)]).standard_error == 0.0
    assert crossed_mean([crossing(values, setups)]).mean == pytest.approx(0.75)
    assert crossed_mean([crossing(values, setups)], balanced=True).mean == pytest.approx(0.5)


def test_models_of_several_data_sets_are_nested_in_them():
    rng = np.random.default_rng(3)
    models = [rng.normal(size=4), rng.normal(size=4)]
    found = crossed_mean([crossing(np.repeat(x[None], 10, axis=0)) for x in models])
    assert found.mean == pytest.approx(np.mean(models))
    assert found.standard_error == pytest.approx(np.sqrt(sum(x.var(ddof=1) / 4 for x in models)) / 2)
    assert 3 < found.degrees <= 6


def test_nothing_is_said_about_models_where_there_is_one_or_about_trials_where_a_setup_has_one():
    assert crossed_mean([crossing(np.ones((5, 1)))]) is None
    assert crossed_mean([crossing(np.ones((5, 3))), crossing(np.ones((5, 1)))]) is None
    assert crossed_mean([crossing(np.ones((3, 3)), [0, 0, 1])]) is None
    with pytest.raises(ValueError, match="at least one data set"):
        crossed_mean([])


@pytest.mark.parametrize("models", [0.0, 0.01, 0.03])
def test_the_test_keeps_its_level_with_five_models(models):
    """Type I error of 94 trials in six setups; without the models' part, .03 would give a fifth of false alarms."""
    rng, setups = np.random.default_rng(4), np.repeat(np.arange(6), [24, 14, 14, 14, 14, 14])
    rejected = 0
    for _ in range(600):
        x = rng.normal(0, 0.12, (94, 1)) + rng.normal(0, models, 5) + rng.normal(0, 0.08, (94, 5))
        rejected += crossed_mean([crossing(x, setups)]).p_value() < 0.05
    assert 0.02 < rejected / 600 < 0.08


def sample(values, data="d"):
    """(n, m) values as a sample of n trials in one setup with m models."""
    return {("N1M1", data, i): {f"m{j}": v for j, v in enumerate(row)} for i, row in enumerate(values)}


def test_a_method_that_no_model_changes_is_paired_with_every_model():
    ours = {("N1M1", "d", 0): {"a": [0.5], "b": [0.7]}}
    others = {("N1M1", "d", 0): {ANY_MODEL: [0.4]}}
    assert paired(ours, others) == {("N1M1", "d", 0): {"a": ([0.5], [0.4]), "b": ([0.7], [0.4])}}
    assert paired(others, others) == {("N1M1", "d", 0): {ANY_MODEL: ([0.4], [0.4])}}
    assert paired(ours, {("N1M1", "d", 0): {"c": [1.0]}}) == {}


def test_with_several_models_a_difference_that_one_model_makes_is_not_significant():
    rng = np.random.default_rng(5)
    values = rng.normal(0.0, 0.05, (40, 1)) + np.array([0.3, 0.0, 0.0, 0.0, 0.0])
    crossed = paired_difference(sample(values), rng, rng)
    alone = paired_difference(sample(values.mean(axis=1, keepdims=True)), rng, rng)
    assert crossed["mean_difference"] == pytest.approx(alone["mean_difference"])
    assert alone["p_value"] < 0.001
    assert crossed["p_value"] > 0.2
    low, high = crossed["ci95"]
    assert low < 0.0 < high
    assert n_models(sample(values)) == 5


def test_a_setup_with_one_trial_has_no_test_where_models_are_several(rng):
    values = sample(np.random.default_rng(7).uniform(size=(5, 3))) | {
        ("N3M4", "d", 9): {"m0": 0.1, "m1": 0.2, "m2": 0.3}
    }
    found = paired_difference(values, rng, rng)
    assert (found["ci95"], found["p_value"]) == (None, None)
    assert found["mean_difference"] == pytest.approx(np.mean([np.mean(list(m.values())) for m in values.values()]))
    assert paired_difference({}, rng, rng)["mean_difference"] is None


def test_trials_that_lack_a_model_are_left_out_of_the_interval(rng):
    values = sample(np.random.default_rng(6).uniform(size=(12, 4)))
    whole = interval_of_mean(values, rng)
    cut = {unit: dict(list(models.items())[: 4 - (unit[2] == 11)]) for unit, models in values.items()}
    assert interval_of_mean(cut, rng) == interval_of_mean({u: m for u, m in values.items() if u[2] != 11}, rng) != whole


def many_scores(rng, n, mean):
    scores = np.clip(rng.normal(mean, 0.3, n), 0.0, 1.0)
    return {("N1M1" if i % 3 else "N2M1", "data", i): {"model": float(score)} for i, score in enumerate(scores)}


@pytest.mark.parametrize("balanced", [False, True])
def test_of_many_trials_of_one_model_t_says_what_resampling_says(balanced, monkeypatch):
    scores = many_scores(np.random.default_rng(4), MAX_RESAMPLED + 1, 0.6)
    by_t = interval_of_mean(scores, np.random.default_rng(0), balanced)
    monkeypatch.setattr("cutgrammar.results.samples.MAX_RESAMPLED", 10**6)
    resampled = interval_of_mean(scores, np.random.default_rng(0), balanced)
    assert by_t != resampled
    assert by_t == pytest.approx(resampled, abs=0.05 * (resampled[1] - resampled[0]))


@pytest.mark.parametrize("mean", [0.0, 0.03, 0.06])
def test_of_many_trials_of_one_model_a_test_says_what_random_signs_say(mean, monkeypatch):
    rng = np.random.default_rng(1)
    differences = {
        unit: {"model": x["model"] - 0.5 + mean} for unit, x in many_scores(rng, MAX_RESAMPLED + 1, 0.5).items()
    }
    by_t = paired_difference(differences, *map(np.random.default_rng, (0, 1)))
    monkeypatch.setattr("cutgrammar.results.statistics.MAX_RESAMPLED", 10**6)
    resampled = paired_difference(differences, *map(np.random.default_rng, (0, 1)))
    assert by_t["p_value"] != resampled["p_value"]
    assert by_t["p_value"] == pytest.approx(resampled["p_value"], abs=0.02)
    assert by_t["mean_difference"] == resampled["mean_difference"]


def test_a_setup_with_a_single_one_of_many_trials_leaves_the_interval_unknown():
    scores = many_scores(np.random.default_rng(4), MAX_RESAMPLED + 1, 0.6) | {("N3M1", "data", 999): {"model": 0.5}}
    assert interval_of_mean(scores, np.random.default_rng(0)) is None
    assert paired_difference(scores, *map(np.random.default_rng, (0, 1)))["p_value"] < 0.001


@pytest.mark.parametrize(("difference", "p_value"), [(0.0, 1.0), (0.1, 0.0)])
def test_many_equal_differences_have_a_p_value(difference, p_value):
    assert paired_test([difference] * (MAX_RESAMPLED + 1), np.random.default_rng(0)) == p_value
