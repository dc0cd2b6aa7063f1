"""Human Rating: who counts, means and intervals."""

import numpy as np
import pytest

from cutgrammar.results.comparisons import ALL
from cutgrammar.results.human_rating import human_ratings, judge
from cutgrammar.results.rater_agreement import ordinal_alpha
from cutgrammar.trials.rating_plan import OTHER, SAME, Pair
from cutgrammar.trials.record import TrialKey
from made_ratings import answer, answers, result

WHERE = ("in-place", "bench", "truth")


def key(trial, method="bc", setup="N1M1"):
    return TrialKey(setup, trial, "in-place", method, 0, "bench", "truth", "o")


def trials_of(keys):
    return {k.digest: (WHERE, k.method, (k.setup, "d", k.trial)) for k in keys}


PASSED = [(Pair(SAME, key(0)), 5), (Pair(OTHER, key(0), key(1)), 1)]


def rated(rater, values, method="bc", checks=PASSED, robot=False):
    """A rater who gives `values` to the trials 0, 1, ..."""
    return answers(rater, [*checks, *((result(key(i, method)), value) for i, value in enumerate(values))], robot)


def test_mean_and_deviation_are_those_of_the_single_ratings():
    found = human_ratings(rated("A", [1, 2, 4]) + rated("B", [2, 2, 5]), trials_of(map(key, range(3))))
    cell = found.fields[WHERE]["N1M1", "bc"]
    values = [1, 2, 4, 2, 2, 5]
    assert cell["human_rating_mean"] == pytest.approx(np.mean(values))
    assert cell["human_rating_std"] == pytest.approx(np.std(values, ddof=1))
    assert (cell["human_rating_ratings"], cell["human_rating_raters"]) == (6, 2)
    low, high = cell["human_rating_ci95"]
    assert 1.0 <= low < cell["human_rating_mean"] < high <= 5.0
    assert found.shared == 3
    counts = [[1, 1, 0, 0, 0], [0, 2, 0, 0, 0], [0, 0, 0, 1, 1]]
    assert found.alpha == pytest.approx(ordinal_alpha(counts))


def test_the_interval_is_unknown_with_one_rater_or_one_trial():
    trials = trials_of(map(key, range(3)))
    assert human_ratings(rated("A", [1, 2, 4]), trials).fields[WHERE]["N1M1", "bc"]["human_rating_ci95"] is None
    two = human_ratings(rated("A", [1]) + rated("B", [2]), trials)
    assert two.fields[WHERE]["N1M1", "bc"]["human_rating_ci95"] is None


def test_intervals_cover_the_mean_where_raters_and_trials_both_vary(monkeypatch):
    """Of 60 made-up panels most intervals cover the true mean 3: an interval over ratings alone would cover half."""
    monkeypatch.setattr("cutgrammar.results.human_rating.N_RESAMPLES", 300)
    trials = trials_of(map(key, range(12)))
    covered = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        of_trials = rng.normal(0, 0.7, 12)
        ratings = []
        for rater in "ABCDEF":
            values = 3 + rng.normal(0, 0.5) + of_trials + rng.normal(0, 0.4, 12)
            ratings += rated(rater, np.clip(np.rint(values), 1, 5).astype(int).tolist())
        low, high = human_ratings(ratings, trials).fields[WHERE]["N1M1", "bc"]["human_rating_ci95"]
        covered += low <= 3 <= high
    assert covered >= 52


def test_every_setup_counts_once_in_the_mean_of_setups():
    keys = [key(i) for i in range(4)] + [key(9, setup="N2M1")]
    ratings = answers("A", [*PASSED, *((result(k), 1) for k in keys[:4]), (result(keys[4]), 5)])
    found = human_ratings(ratings, trials_of(keys))
    assert found.over_setups[WHERE]["bc"]["human_rating_mean"] == pytest.approx(3.0)
    assert found.fields[WHERE][ALL, "bc"]["human_rating_mean"] == pytest.approx(9 / 5)


def test_who_counts_is_decided_by_checks_and_robots():
    same, other = Pair(SAME, key(0)), Pair(OTHER, key(0), key(1))
    more = [Pair(SAME, key(i)) for i in range(1, 3)]
    ratings = [
        *rated("good", [3]),
        *rated("robot", [3], robot=True),
        *rated("early", [3], checks=[(same, 5)]),
        *rated("blind", [3], checks=[(same, 3), (other, 1)]),
        *rated("high", [3], checks=[(same, 5), (other, 3)]),
        *rated("once", [3], checks=[(same, 3), (other, 2), *((pair, 4) for pair in more)]),
    ]
    verdicts = {one.rater: one for one in judge(ratings)}
    assert verdicts["good"].reason == verdicts["once"].reason == ""
    assert verdicts["robot"].reason == "a test robot"
    assert verdicts["early"].reason == "fewer than 2 attention checks answered"
    assert verdicts["blind"].reason == verdicts["high"].reason == "missed 1 of 2 attention checks"
    assert (verdicts["once"].ratings, verdicts["once"].checks, verdicts["once"].missed) == (1, 4, 1)
    found = human_ratings(ratings, trials_of([key(0), key(1), key(2)]))
    assert found.fields[WHERE]["N1M1", "bc"]["human_rating_raters"] == 2


def test_one_answer_of_a_robot_makes_all_of_its_code_a_robots():
    ratings = rated("A", [3, 4])
    assert judge([*ratings, answer("A", result(key(2)), 3, robot=True)])[0].reason == "a test robot"


def test_the_last_answer_counts_and_changes_are_told():
    ratings = [*rated("A", [1, 1]), answer("A", result(key(0)), 5, place=2, answer=2)]
    found = human_ratings(ratings, trials_of([key(0), key(1)]))
    assert found.fields[WHERE]["N1M1", "bc"]["human_rating_mean"] == pytest.approx(3.0)
    assert found.raters[0].changed == 1
    assert found.raters[0].ratings == 2


def test_ratings_of_other_runs_are_left_out():
    assert human_ratings(rated("A", [1]), {}) is None
