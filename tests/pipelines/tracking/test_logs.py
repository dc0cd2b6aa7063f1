import csv
import io
import json
import subprocess
import sys

import pytest

from cutgrammar.results.score_table import Row, numbers_of
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from cutgrammar_pipelines.tracking.run_log import RunLog, flat


@pytest.fixture(scope="module")
def everything(scored_run):
    return evaluation_logs(scored_run, build_report([scored_run]))


@pytest.fixture(scope="module")
def logs(everything):
    return everything[:-1]


def test_an_evaluation_is_one_run_a_method_with_its_seeds_as_children_and_one_of_the_report(everything, scored_run):
    *logs, report = everything
    assert [log.name for log in logs] == ["grammar", "largest", "random", "replay"]
    assert {log.tags["kind"] for log in logs} == {"method"}
    assert (report.tags["kind"], report.children) == ("report", ())
    runs = {record.key.run for record in read_records(ledger_of(scored_run))}
    assert {len(log.children) for log in logs} == {len(runs)}
    keys = [log.key for log in logs] + [child.key for log in logs for child in log.children]
    assert len(set(keys)) == len(keys) == 4 * (1 + len(runs))


def test_the_top_level_run_carries_the_reports_numbers_one_a_setup(logs, scored_run):
    rows = {(row["method"], row["setup"]): row for row in build_report([scored_run]).numbers["rows"]}
    for log in logs:
        method = log.params["method"]
        setups = [setup for other, setup in rows if other == method]
        assert {"N1M1", "all"} <= set(setups)
        for setup in setups:
            assert log.metrics[f"iou_strict/{setup}"] == rows[method, setup]["iou_strict_mean"]
            assert log.metrics[f"iou/{setup}"] == rows[method, setup]["iou_mean"]
            assert log.metrics[f"stuck/{setup}"] == rows[method, setup]["stuck"]
        assert not [name for name in log.metrics if name.startswith(("spectral", "agreement"))], (
            "not known, so not told"
        )


def test_the_worst_run_and_the_differences_from_the_reference_method_are_metrics(logs, scored_run):
    numbers = build_report([scored_run]).numbers
    worst = {row["method"]: row["iou_strict_worst_run"] for row in numbers["rows"] if row["setup"] == "all"}
    tests = {test["method"]: test for test in numbers["tests"] if test["setup"] == "all"}
    for log in logs:
        method = log.params["method"]
        assert log.metrics["iou_strict_worst_run/all"] == worst[method]
        difference = tests[method]["mean_difference"] if method in tests else None
        assert log.metrics.get("difference_from_grammar/all") == difference
    assert logs[1].metrics["p_against_grammar/all"] == tests["largest"]["p_corrected"]


def test_the_mean_over_setups_is_the_mean_of_the_setups_metrics(logs):
    for log in logs:
        of_setups = [log.metrics[f"iou_strict/{setup}"] for setup in ("N1M1", "N2M1", "N3M4")]
        assert log.metrics["iou_strict/mean"] == pytest.approx(sum(of_setups) / 3)


def test_goal_conditions_share_a_methods_run_and_have_sections_of_their_own(made, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1"], goals=("in-place", "scattered"))
    run = made.write_run(tmp_path / "run", facts, records, records)
    *logs, _ = evaluation_logs(run, build_report([run]))
    assert [log.name for log in logs] == ["grammar", "largest", "random", "replay"]
    rows = {(row["method"], row["goals"]): row for row in build_report([run]).numbers["rows"]}
    for log in logs:
        for goals, name in (("in-place", "iou_strict/N1M1"), ("scattered", "iou_strict/scattered/N1M1")):
            assert log.metrics[name] == rows[log.name, goals]["iou_strict_mean"]
        assert log.tags["goals"] == "in-place, scattered"


def test_names_tell_the_worlds_and_the_evaluations_of_a_study_apart(arm_run, made, tmp_path):
    assert [log.name for log in evaluation_logs(arm_run, build_report([arm_run]))] == [
        "grammar, bench, truth",
        "grammar, kinova, truth",
        "report of run",
    ]
    facts = made.facts_of()
    records = made.records_of(facts, setups=["N1M1"], methods=["random"])
    other = made.write_run(tmp_path / "slow", facts, records, records)
    assert evaluation_logs(other, build_report([other]))[0].name == "random (slow)"


def test_a_rating_that_comes_later_is_one_more_metric(scored_run):
    report = build_report([scored_run])
    for row in report.numbers["rows"]:
        row["human_rating_mean"] = 3.5
    logs = evaluation_logs(scored_run, report)
    assert {log.metrics["human_rating/N1M1"] for log in logs[:-1]} == {3.5}


def test_a_childs_metrics_are_the_numbers_of_a_report_of_its_rows_alone(logs, scored_run):
    facts = read_run(scored_run)
    records = [r for r in read_records(ledger_of(scored_run)) if (r.key.method, r.key.run) == ("grammar", 0)]
    numbers = numbers_of(Row.of(record, facts) for record in records).to_json()
    metrics = logs[0].children[0].metrics
    assert logs[0].name == "grammar"
    for row in [*numbers["rows"], *({**mean, "setup": "mean"} for mean in numbers["setup_means"])]:
        assert metrics[f"iou_strict/{row['setup']}"] == row["iou_strict_mean"]
        if row["iou_strict_ci95"] is not None:
            assert metrics[f"iou_strict_ci95_low/{row['setup']}"] == row["iou_strict_ci95"][0]


def test_the_mean_over_the_children_is_what_the_parent_carries(logs):
    for log in logs:
        strict = [child.metrics["iou_strict/N2M1"] for child in log.children]
        assert sum(strict) / len(strict) == pytest.approx(log.metrics["iou_strict/N2M1"])


def test_settings_are_params_digests_are_tags_and_data_an_input(logs):
    for log in logs:
        assert log.params["search.max_rounds"] == 50
        assert log.tags["data"] == "d" * 64
        assert log.tags["model"] == "m" * 64
        assert log.inputs[0].digest == "d" * 64


def test_the_table_of_trials_has_a_row_a_trial_and_run(logs, scored_run):
    rows = list(csv.DictReader(io.StringIO(logs[2].texts["trials.csv"])))
    random = [record for record in read_records(ledger_of(scored_run)) if record.key.method == "random"]
    assert len(rows) == len(random)
    assert [float(row["iou_strict"]) for row in rows] == [record.iou_strict for record in random]
    assert {row["status"] for row in rows} == {"done", "stuck"}


def test_the_run_of_the_report_holds_its_numbers_and_its_figures(everything):
    assert json.loads(everything[-1].texts["report.json"])["schema"] == 1
    drawn = everything[-1].drawn()
    assert {name.split("/")[0] for name in drawn} == {"figures"}
    figures = list(drawn.values())
    assert len(figures) >= 2
    assert all(text.startswith("<svg") and 'xmlns="http://www.w3.org/2000/svg"' in text for text in figures)


def test_the_same_run_folder_says_the_same(everything, scored_run):
    again = evaluation_logs(scored_run, build_report([scored_run]))
    assert [(log.key, log.content) for log in again] == [(log.key, log.content) for log in everything]


def test_a_runs_content_covers_its_files_and_children(tmp_path):
    file = tmp_path / "a"
    file.write_text("1")
    log = RunLog("a", {"a": 1}, files=(file,), children=(RunLog("b", {"b": 1}),))
    before = log.content
    assert before == log.content
    file.write_text("2")
    assert log.content != before
    other = RunLog("a", {"a": 1}, files=(file,), children=(RunLog("b", {"b": 1}, metrics={"x": 1.0}),))
    assert other.content != log.content
    assert other.key == log.key


def test_nested_settings_become_flat_names():
    assert flat({"a": {"b": 1, "c": {"d": 2}}, "e": 3}) == {"a.b": 1, "a.c.d": 2, "e": 3}


def test_importing_this_module_leaves_the_heavy_libraries_alone():
    heavy = "[n for n in ('torch', 'mlflow', 'ray') if n in sys.modules]"
    code = f"import sys, cutgrammar_pipelines.tracking.mlflow_store; print({heavy})"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )
