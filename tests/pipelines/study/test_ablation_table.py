import dataclasses
import json

import numpy as np
import pytest

from cutgrammar.results.score_table import Row
from cutgrammar.trials.scores import installed_scores
from cutgrammar_dashboards.report.page import page
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.study.ablation_report import ablation_report
from cutgrammar_pipelines.study.ablation_table import ORACLES, Evaluated, ablation_table, oracle_table, transfer_table


@pytest.fixture(scope="module")
def evaluated(made):
    """Makes an evaluation whose strict IoU is the base's plus a shift."""

    def make(name, question, shift=0.0, seed=0, changes=None, **chosen):
        records = made.records_of(made.facts_of(), **{"methods": ("grammar", "largest"), "runs": 3, **chosen})
        rows = tuple(
            Row(dataclasses.replace(r, scores=r.scores | {"iou_strict": r.iou_strict + shift}), "d" * 64)
            for r in records
        )
        facts = {"changes": changes or {}, "k": 20, "training_trials": 16, "training_seed": seed}
        return Evaluated(name, question, rows, facts)

    return make


@pytest.fixture(scope="module")
def summary(evaluated):
    """A base, three variants on fewer trials and runs, two seeds of training, a transfer."""
    base = evaluated("base", "", trials=4)
    variants = [
        evaluated("k-4", "types", -0.1, changes={"induction.fixed_k": 4}, runs=2, methods=("grammar",)),
        evaluated("seed-1", "seed", 0.02, seed=1, runs=2),
        evaluated("seed-2", "seed", -0.02, seed=2, runs=2),
        evaluated("k-8", "types", 0.05, changes={"induction.fixed_k": 8}, runs=2, methods=("grammar",)),
    ]
    words = {"trained": "carrot", "tested": "potato", "training_trials": 16}
    other = Evaluated("c2p-other-food", "c2p", evaluated("x", "x", setups=("N1M1",)).rows, words)
    return {
        "schema": 1,
        **ablation_table(base, variants),
        "oracles": [],
        "transfers": transfer_table([other]),
    }


def test_a_variant_is_compared_with_the_base_on_the_trials_and_runs_that_it_has(summary):
    rows = {(row["variant"], row["method"], row["question"]): row for row in summary["rows"]}
    k4 = rows["k-4", "grammar", "types"]
    assert k4["mean_difference"] == pytest.approx(-0.1, abs=1e-12)
    assert k4["ci95"] == pytest.approx([-0.1, -0.1], abs=1e-12)
    base = rows["base", "grammar", "types"]
    assert (base["trials"], base["runs"]) == (k4["trials"], k4["runs"]) == (6, 2)
    assert base["iou_strict_mean"] == pytest.approx(k4["iou_strict_mean"] + 0.1)
    assert base["mean_difference"] is None
    assert {f"{score.name}_mean" for score in installed_scores()} <= set(k4)
    assert ("base", "largest", "types") not in rows
    assert ("base", "largest", "seed") in rows


def test_variants_of_one_question_follow_the_base(summary):
    assert [row["variant"] for row in summary["rows"] if row["question"] == "types"] == ["base", "k-4", "k-8"]
    assert [row["question"] for row in summary["rows"]] == ["types"] * 3 + ["seed"] * 6


def test_p_values_are_corrected_for_all_variants_of_a_method(summary):
    own = [row for row in summary["rows"] if row["method"] == "grammar" and row["p_value"] is not None]
    assert len(own) == 4
    assert all(row["p_corrected"] >= row["p_value"] for row in own)
    assert min(row["p_corrected"] for row in own) == pytest.approx(min(1.0, 4 * min(row["p_value"] for row in own)))


def test_models_that_differ_in_their_seed_alone_give_a_spread_over_seeds(summary):
    (found,) = [row for row in summary["training_seeds"] if row["method"] == "grammar"]
    assert found["training_seeds"] == [0, 1, 2]
    assert np.diff(found["iou_strict_means"]) == pytest.approx([0.02, -0.04])
    assert found["iou_strict_std_seeds"] == pytest.approx(0.02)


def test_the_first_score_the_gains_of_oracles_and_the_remainder_sum_to_one(made):
    facts = made.facts_of()
    level = dict(zip(ORACLES, (0.5, 0.6, 0.7, 0.9), strict=True))
    rows = []
    for method, score in level.items():
        trials = 3 if method == "grammar" else 2  # an oracle has fewer trials: only those are compared
        for record in made.records_of(facts, methods=("grammar",), trials=trials):
            key = dataclasses.replace(record.key, method=method)
            rows += [
                Row(dataclasses.replace(record, key=key, scores={"iou_strict": score + 0.01 * key.trial}), "d" * 64)
            ]
    table = oracle_table(rows)
    assert [row["setup"] for row in table] == [*made.setups, "all"]
    for row in table:
        total = row["scores"]["grammar"] + sum(step["mean_difference"] for step in row["adds"]) + row["remainder"]
        assert total == pytest.approx(1.0)
        assert [step["oracle"] for step in row["adds"]] == list(ORACLES[1:])
        assert [step["mean_difference"] for step in row["adds"]] == pytest.approx([0.1, 0.1, 0.2])
    assert table[-1]["trials"] == 2 * len(made.setups)
    assert oracle_table(row for row in rows if row.record.key.method == "grammar") == []


def test_a_transfer_names_foods_methods_and_tests(summary):
    by_method = {row["method"]: row for row in summary["transfers"]}
    assert by_method["grammar"]["mean_difference"] is None
    assert by_method["largest"]["mean_difference"] < 0
    assert by_method["largest"]["tested"] == "potato"


def test_the_summary_does_not_depend_on_the_order_of_rows(evaluated):
    base, variant = evaluated("base", ""), evaluated("k-4", "types", -0.1)
    turned = [dataclasses.replace(one, rows=one.rows[::-1]) for one in (base, variant)]
    assert json.dumps(ablation_table(base, [variant])) == json.dumps(ablation_table(turned[0], [turned[1]]))


def test_the_summary_can_be_read_as_text_and_as_a_page(summary, tmp_path):
    report = ablation_report(summary)
    text = as_text(report, 100)
    assert "types, goals in-place" in text
    assert "induction.fixed_k 4" in text
    assert "training seed 1" in text
    assert "learned from 16 trials with carrot alone" in text.replace("\n", " ")
    shown = page(report, tmp_path)
    assert shown.count("<table") == 4
    assert shown.count("<svg") == 1
    assert "http" not in shown.replace("http-equiv", "").replace("http://www.w3.org", "")
