"""Scores and methods of other packages in reports: one entry point each, and no edit of this project."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import pytest

from cutgrammar.plugins import METHODS, WORLDS, reference_of
from cutgrammar.settings import Settings
from cutgrammar.storage.ledger import Ledger, read_records
from cutgrammar.storage.run_folder import ledger_of, settle_run
from cutgrammar.trials.record import TrialKey
from cutgrammar.trials.scores import computed_scores
from cutgrammar_dashboards.report.page import page
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs
from cutgrammar_workers.trial_worker import EvaluationContext, Job, TrialWorker

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "07_your_own_score.py"


@pytest.fixture
def own_score(install):
    install("your_own_score", EXAMPLE.read_text(), scores={"volume_error": "VOLUME_ERROR"})


@pytest.fixture
def run(own_score, made, demonstrate, tmp_path):
    """A run of two trials on the bench, scored by all installed scores."""
    facts, folder = made.facts_of(), tmp_path / "run"
    context = EvaluationContext(
        seed=0,
        settings=Settings(),
        models={facts.origin: SimpleNamespace(digest=facts.model_digests[0])},
        methods={name: reference_of(METHODS, name) for name in ("random", "largest")},
        world=reference_of(WORLDS, "bench"),
        perception="truth",
        package="0.1.0",
        planners=1,
        record="none",
        recorder="",
        scores=computed_scores(),
    )
    worker, demonstration = TrialWorker(context), demonstrate()
    settle_run(folder, facts)
    with Ledger(ledger_of(folder)) as ledger:
        for method in ("random", "largest"):
            key = TrialKey("N1M1", 0, "in-place", method, 0, "bench", "truth", facts.origin)
            outcome = worker(Job(key, demonstration))
            assert outcome.record.status == "done"
            ledger.add(outcome.record, outcome.configurations)
    return folder


def test_a_score_of_another_package_appears_wherever_scores_do(run, tmp_path):
    values = [record.scores["volume_error"] for record in read_records(ledger_of(run))]
    assert all(0.0 < value < 1.0 for value in values)
    report = build_report([run])
    row = next(row for row in report.numbers["rows"] if (row["setup"], row["method"]) == ("all", "random"))
    mean = next(r.scores["volume_error"] for r in read_records(ledger_of(run)) if r.key.method == "random")
    assert row["volume_error_mean"] == pytest.approx(mean)
    for shown in (as_text(report), page(report, tmp_path)):
        assert "volume error" in shown
        assert f"{mean:.3f}" in shown
        assert "Mean difference of the volumes of matched fragments" in " ".join(shown.split())
    (log,) = [log for log in evaluation_logs(run, report) if log.params.get("method") == "random"]
    assert log.metrics["volume_error/N1M1"] == pytest.approx(mean)
    assert "volume_error" in log.texts["trials.csv"].splitlines()[0]


@pytest.mark.parametrize("command", ["report", "evaluate"])
def test_help_lists_the_score_of_another_package(own_score, command, capsys):
    assert main([command, "--help"]) == 0
    assert "Mean difference of the volumes of matched fragments" in " ".join(capsys.readouterr().out.split())


def test_a_run_whose_score_is_no_longer_installed_still_has_its_numbers(made, tmp_path):
    facts = made.facts_of()
    records = [dataclasses.replace(r, scores=r.scores | {"gone": 0.25}) for r in made.records_of(facts)]
    report = build_report([made.write_run(tmp_path / "run", facts, records, records)])
    assert all(row["gone_mean"] == 0.25 for row in report.numbers["rows"])
    assert "gone: Score 'gone' is not installed." in as_text(report)


def test_methods_that_are_not_installed_do_not_compete(made, tmp_path, monkeypatch):
    facts = made.facts_of()
    monkeypatch.setitem(made.level, "gone", 0.9)
    records = made.records_of(facts, methods=("gone", "largest", "grammar"))
    report = build_report([made.write_run(tmp_path / "run", facts, records, records)])
    assert report.series == ("grammar", "largest", "gone")
    assert report.dashed == {"gone"}
    text = as_text(report)
    assert "gone ‡" in text
    assert "it is unknown whether it sees the demonstration" in " ".join(text.split())
