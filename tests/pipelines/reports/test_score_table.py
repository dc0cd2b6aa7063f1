"""The numbers of a report are those computed by hand."""

import random
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from cutgrammar.results.score_table import Row, numbers_of, table_of
from report_rows import only, row


def test_further_scores_are_means_over_trials_of_what_is_known_of_their_runs(made):
    rows = [
        row(made, trial=0, run=0, scores={"iou_refined": 0.5, "spectral": 0.25, "agreement": 1.0}),
        row(made, trial=0, run=1, scores={"iou_refined": 0.7, "spectral": 0.75, "agreement": 0.5}),
        row(made, trial=1, run=0, scores={"iou_refined": 0.2, "spectral": None, "agreement": 0.0}),
    ]
    found = only(table_of(rows), setup="N1M1")
    assert found["iou_refined_mean"] == pytest.approx((0.6 + 0.2) / 2)
    assert found["spectral_mean"] == pytest.approx(0.5)
    assert found["agreement_mean"] == pytest.approx((0.75 + 0.0) / 2)


def test_means_and_spreads_are_those_computed_by_hand(made):
    scores = {(0, 0): 0.2, (0, 1): 0.4, (1, 0): 0.6, (1, 1): 1.0}
    built = table_of(row(made, trial=t, run=r, strict=v) for (t, r), v in scores.items())
    found = only(built, setup="N1M1")
    assert found["iou_strict_mean"] == pytest.approx(0.55)
    assert found["iou_strict_std_runs"] == pytest.approx(np.std([0.4, 0.7], ddof=1))
    assert found["iou_strict_ci95"] == pytest.approx([0.3, 0.8])


def test_all_weighs_trials_not_setups(made):
    rows = [row(made, trial=t, strict=0.0) for t in range(3)] + [row(made, setup="N2M1", trial=9, strict=1.0)]
    assert only(table_of(rows), setup="all")["iou_strict_mean"] == 0.25


def test_a_trial_of_unknown_outcome_counts_zero_strictly_and_not_at_all_in_the_matched_mean(made):
    rows = [
        row(made, trial=0, strict=0.8),
        row(made, trial=1, strict=0.0, scores={"iou": None}, status="crashed", reason="died"),
    ]
    found = only(table_of(rows), setup="all")
    assert found["iou_strict_mean"] == 0.4
    assert found["iou_mean"] == pytest.approx(0.8)
    assert (found["failures"], found["stuck"], found["trials"]) == (1, 0, 2)
    lost = only(table_of(rows[1:]), setup="all")
    assert lost["iou_mean"] is None
    assert lost["iou_std_runs"] is None


def test_failed_and_stuck_are_counted_apart(made):
    statuses = ["done", "failed", "crashed", "timeout", "stuck", "stuck"]
    found = only(table_of(row(made, trial=i, status=s) for i, s in enumerate(statuses)), setup="all")
    assert (found["failures"], found["stuck"]) == (3, 2)


def test_the_order_of_rows_changes_nothing(made):
    facts = made.facts_of()
    rows = [Row(record, "d") for record in made.records_of(facts, trials=3, runs=2)]
    first = table_of(rows)
    random.Random(4).shuffle(rows)
    assert table_of(rows) == first


def test_methods_are_tested_against_grammar_on_the_trials_both_have(made):
    rows = [row(made, trial=t, strict=0.5 + 0.01 * t) for t in range(8)]
    rows += [row(made, trial=t, method="random", strict=0.3 + 0.01 * t) for t in range(2, 8)]
    test = table_of(rows)["tests"][-1]
    assert (test["setup"], test["method"], test["against"]) == ("all", "random", "grammar")
    assert test["mean_difference"] == pytest.approx(-0.2)
    assert test["ci95"] == pytest.approx([-0.2, -0.2])
    assert test["p_value"] == pytest.approx(2 / 2**6)


def test_without_grammar_there_is_no_test(made):
    assert table_of([row(made, method="random")])["tests"] == []


def test_goal_conditions_stand_apart(made):
    built = table_of([row(made, strict=0.9), row(made, strict=0.1, goals="scattered")])
    assert only(built, setup="all", goals="in-place")["iou_strict_mean"] == 0.9
    assert only(built, setup="all", goals="scattered")["iou_strict_mean"] == 0.1


def test_goal_conditions_stand_in_their_own_order(made):
    rows = [row(made, goals=goals) for goals in ("scattered", "foreign", "in-place", "foreign-food")]
    order = [numbers.condition[0] for numbers in numbers_of(rows).conditions]
    assert order == ["in-place", "scattered", "foreign", "foreign-food"]


def test_trials_of_two_data_sets_are_two_trials_and_runs_of_two_seeds_two_runs(made):
    assert only(table_of([row(made), row(made, data="e", origin="p")]), setup="all")["trials"] == 2
    found = only(table_of([row(made, strict=0.2), row(made, origin="p", strict=0.4)]), setup="all")
    assert found["trials"] == 1
    assert found["iou_strict_std_runs"] == pytest.approx(np.std([0.2, 0.4], ddof=1))


def test_the_mean_over_setups_counts_every_setup_once(made):
    rows = [row(made, trial=t, run=r, strict=0.1 * r) for t in range(3) for r in range(2)]
    rows += [row(made, setup="N2M1", trial=9, run=r, strict=0.8 + 0.1 * r) for r in range(2)]
    built = table_of(rows)
    (found,) = built["setup_means"]
    assert (found["method"], found["setups"]) == ("grammar", 2)
    assert found["iou_strict_mean"] == pytest.approx((0.05 + 0.85) / 2)
    assert found["iou_strict_std_runs"] == pytest.approx(np.std([0.4, 0.5], ddof=1))
    assert found["iou_strict_ci95"] is None
    assert only(built, setup="all")["iou_strict_mean"] == pytest.approx((3 * 0.05 + 0.85) / 4)
    assert found["iou_refined_mean"] is None


def test_the_mean_over_setups_has_an_interval_and_no_score_that_a_setup_lacks(made):
    rows = [row(made, trial=t, strict=0.5) for t in range(2)]
    rows += [row(made, setup="N2M1", trial=t, strict=0.7, scores={"iou": None}) for t in range(8, 12)]
    (found,) = table_of(rows)["setup_means"]
    assert found["iou_strict_ci95"] == pytest.approx([0.6, 0.6])
    assert found["iou_mean"] is None
    assert found["iou_std_runs"] is None


def test_the_chance_to_be_better_is_that_counted_by_hand(made):
    rows = [row(made, trial=t, run=r, strict=s) for t, scores in enumerate([(0.5, 0.7), (0.4, 0.4)]) for r, s in
            enumerate(scores)]  # fmt: skip
    rows += [row(made, method="bc", trial=0, run=r, strict=0.6) for r in range(2)]
    rows += [row(made, method="bc", trial=1, run=r, strict=s) for r, s in enumerate((0.4, 0.1))]
    *_, found = table_of(rows)["improvement"]
    assert (found["setup"], found["method"], found["over"], found["trials"]) == ("all", "grammar", "bc", 2)
    assert found["probability"] == pytest.approx((0.5 + 0.75) / 2)
    assert found["ci95"] == pytest.approx([0.5, 0.75])


def test_a_profile_falls_from_all_runs_to_none(made):
    rows = [row(made, trial=t, run=r, strict=0.3 + 0.1 * t + 0.05 * r) for t in range(4) for r in range(2)]
    (found,) = table_of(rows)["profiles"]
    at = dict(zip(found["thresholds"], found["share"], strict=True))
    assert (at[0.0], at[0.5], at[1.0]) == (1.0, 3 / 8, 0.0)
    low, high = found["ci95"]
    assert all(a <= b <= c for a, b, c in zip(low, found["share"], high, strict=True))


def several(made, method, levels, trials=6, data="d", **changes):
    """Rows of one run for each level, with a model of its own."""
    return [
        replace(row(made, trial=t, run=r, method=method, strict=level + 0.01 * t, data=data, **changes), model=f"m{r}")
        for r, level in enumerate(levels)
        for t in range(trials)
    ]


def test_with_several_models_the_spread_is_over_models_and_the_worst_is_named(made):
    rows = several(made, "grammar", (0.5, 0.6, 0.3)) + several(made, "bc", (0.4, 0.4, 0.4))
    numbers = numbers_of(rows)
    assert numbers.runs_are_models
    found = only(numbers.to_json(), setup="all", method="grammar")
    assert (found["runs"], found["iou_strict_worst_run"]) == (3, pytest.approx(0.325))
    assert found["iou_strict_std_runs"] == pytest.approx(np.std([0.5, 0.6, 0.3], ddof=1))
    (test,) = [t for t in numbers.to_json()["tests"] if t["setup"] == "all"]
    assert (test["models"], test["trials"]) == (3, 6)
    assert test["p_value"] == pytest.approx(stats.ttest_1samp([0.1, 0.2, -0.1], 0.0).pvalue)


def test_a_deterministic_control_has_one_run_that_is_compared_with_every_model(made):
    rows = several(made, "grammar", (0.5, 0.6, 0.3)) + several(made, "halve", (0.4,))
    (test,) = [t for t in table_of(rows)["tests"] if t["setup"] == "all"]
    assert (test["models"], test["mean_difference"]) == (3, pytest.approx(-1 / 15))
    assert only(table_of(rows), setup="all", method="halve")["iou_strict_std_runs"] is None


def test_several_reference_methods_each_have_their_tests(made):
    rows = [row for name in ("grammar", "grammar-plus", "bc") for row in several(made, name, (0.5, 0.4))]
    pairs = {(t["method"], t["against"]) for t in table_of(rows)["tests"]}
    assert pairs == {
        ("grammar-plus", "grammar"),
        ("bc", "grammar"),
        ("grammar", "grammar-plus"),
        ("bc", "grammar-plus"),
    }
    chosen = numbers_of(rows, against=["bc"]).to_json()["tests"]
    assert {(t["method"], t["against"]) for t in chosen} == {("grammar", "bc"), ("grammar-plus", "bc")}


def test_models_of_several_data_sets_are_nested_in_them(made):
    rows = several(made, "grammar", (0.5, 0.6)) + several(made, "bc", (0.4, 0.5))
    rows += several(made, "grammar", (0.7, 0.8), data="e", origin="p") + several(
        made, "bc", (0.4, 0.5), data="e", origin="p"
    )
    (test,) = [t for t in table_of(rows)["tests"] if t["setup"] == "all"]
    assert (test["models"], test["trials"]) == (4, 12)
    assert test["mean_difference"] == pytest.approx(-0.2)
