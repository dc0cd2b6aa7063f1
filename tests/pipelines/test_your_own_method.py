"""The documented method of another package, and one that sees the demonstration, in everything that names methods."""

import json
from pathlib import Path

import pytest

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines import EvaluateConfig
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.tracking.evaluation_logs import evaluation_logs

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "05_your_own_method.py"
PEEKER = """
from cutgrammar import Method
from cutgrammar.methods.controls import ReplayPlanner

PEEKER = Method("peeker", lambda context: ReplayPlanner(context.require_demonstration()), sees_demonstration=True)
"""


@pytest.fixture
def run(install, data_folder, model_folder, tmp_path):
    """A run of the example's method and of one that repeats the demonstration without being called an oracle."""
    install("halver", EXAMPLE.read_text(), methods={"halver": "HALVER"})
    install("peeker", PEEKER, methods={"peeker": "PEEKER"})
    folders = {"data": data_folder, "model": model_folder, "out": tmp_path / "run"}
    once = {"setups": ["N1M1", "N1M2"], "runs": 1, "trials": 1, "world": "bench", "workers": 0}
    assert evaluate(EvaluateConfig(**folders, methods=["halver", "random", "peeker"], **once)).complete
    return tmp_path / "run"


def test_a_new_method_is_evaluated_and_named_everywhere_without_an_edit(run, tmp_path, capsys):
    records = read_records(ledger_of(run))
    assert {record.key.method for record in records} == {"halver", "random", "peeker"}
    assert all(record.status == "done" for record in records)
    capsys.readouterr()
    assert main(["report", str(run), "--out", str(tmp_path / "report.html")]) == 0
    text = capsys.readouterr().out
    assert main(["report", str(run), "--json"]) == 0
    as_json = json.loads(capsys.readouterr().out)
    page = (tmp_path / "report.html").read_text()
    logged = [log.params.get("method") for log in evaluation_logs(run, build_report([run]))]
    for name in ("halver", "peeker"):
        assert name in text
        assert name in page
        assert name in json.dumps(as_json)
        assert name in logged
    assert main(["evaluate", "--help"]) == 0
    assert "\n  halver  " in capsys.readouterr().out


def test_a_method_of_another_package_that_sees_the_demonstration_is_marked_and_not_a_competitor(run, tmp_path):
    built = build_report([run])
    assert built.series == ("random", "halver", "peeker")
    assert built.numbers["shown"] == ["peeker"]
    text = as_text(built)
    assert "peeker †" in text
    assert "halver †" not in text


def test_help_describes_a_new_method(install, capsys):
    install("halver", EXAMPLE.read_text(), methods={"halver": "HALVER"})
    assert main(["evaluate", "--help"]) == 0
    assert "halves the largest fragment until there are enough" in " ".join(capsys.readouterr().out.split())
