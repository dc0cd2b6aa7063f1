"""The scripts in studies/, loaded as modules."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar_pipelines.config import CollectConfig, SplitConfig, TrainConfig
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import train
from short_training import SHORT

STUDIES = Path(__file__).parents[2] / "studies"


def script(name):
    spec = importlib.util.spec_from_file_location(name, STUDIES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_report_of_a_packed_ledger_is_the_report_of_the_run(scored_run, tmp_path):
    export = script("export_ledger")
    export.pack(scored_run, tmp_path / "ledger.parquet")
    assert export.report_of(tmp_path / "ledger.parquet").to_json() == build_report([scored_run]).to_json()
    assert (tmp_path / "ledger.parquet").stat().st_size < 40_000
    assert b"somewhere" not in (tmp_path / "ledger.parquet").read_bytes()


def test_an_incomplete_run_is_not_packed(made, tmp_path):
    facts = made.facts_of()
    records = made.records_of(facts)
    run = made.write_run(tmp_path / "run", facts, records, records[1:])
    with pytest.raises(InputError, match="run is incomplete: 1 trials are missing; resume it first"):
        script("export_ledger").pack(run, tmp_path / "ledger.parquet")


def test_a_run_that_repeats_a_test_robot_is_not_packed(made, tmp_path):
    facts = made.facts_of(by_robot=True)
    records = made.records_of(facts)
    run = made.write_run(tmp_path / "run", facts, records, records)
    with pytest.raises(InputError, match="what a test robot did, which enters no table"):
        script("export_ledger").pack(run, tmp_path / "ledger.parquet")
    assert not (tmp_path / "ledger.parquet").exists()


@pytest.fixture
def worth_study(made, tmp_path):
    """A study of two sources of plans and two budgets, with made-up scores: the grammar is .1 better."""
    for structures, level in (("grammar", 0.1), ("halve", 0.0)):
        for evaluations in (120, 12000):
            facts = made.facts_of(settings={"fitting": {"structures": structures, "evaluations": evaluations}})
            records = [
                replace(record, goal_fragments=6 + 10 * (record.key.trial % 2), scores={"iou_strict": score})
                for record in made.records_of(facts, methods=["grammar"], trials=4)
                for score in [level + 0.5 + 0.02 * record.key.trial / 10 + 0.00001 * evaluations]
            ]
            name = f"table-{structures}-{evaluations}"
            (tmp_path / "runs").mkdir(exist_ok=True)
            made.write_run(tmp_path / "runs" / name, facts, records, records)
    return tmp_path


def test_what_the_grammar_is_worth_is_summarised_by_budget_and_number_of_fragments(worth_study, capsys):
    study = script("what_the_grammar_is_worth")
    study.report(worth_study)
    summary = json.loads((worth_study / "summary.json").read_text())
    assert {(row["fragments"], row["evaluations"]) for row in summary["means"]} == {
        (fragments, evaluations) for fragments in ("2 to 8", "9 to 16") for evaluations in (120, 12000)
    }
    assert all(row["mean_difference"] == pytest.approx(0.1) for row in summary["differences"])
    assert {row["trials"] for row in summary["means"]} == {6}
    assert (worth_study / "anytime-meshes.svg").exists()
    assert not (worth_study / "anytime-point-clouds.svg").exists()
    assert "in-place, meshes, 2 to 8 fragments, 120 evaluations: grammar 0.6" in capsys.readouterr().out
    again = script("what_the_grammar_is_worth").trials_in(worth_study)
    assert len(again) == 4 * 24


def test_a_study_without_trials_says_so(tmp_path, capsys):
    assert script("what_the_grammar_is_worth").main(["report", str(tmp_path)]) == 2
    assert "holds no trial yet" in capsys.readouterr().err


def test_a_quick_study_has_few_trials():
    options = script("what_the_grammar_is_worth").parse(["run", "o", "--data", "d", "--model", "m", "n", "--quick"])
    assert (options.trials, options.objects, len(options.model)) == (2, 2, 2)


@pytest.mark.slow
def test_a_small_study_of_what_the_grammar_is_worth_runs_and_resumes(tmp_path, monkeypatch, capsys):
    study = script("what_the_grammar_is_worth")
    monkeypatch.setattr(study, "DICE", (8,))
    data, model, out = tmp_path / "data", tmp_path / "model", tmp_path / "worth"
    collect(CollectConfig(out=data, trials=6, setups=["N1M1"], workers=0))
    split(SplitConfig([data], out=data))
    train(TrainConfig(data=data, out=model, settings=SHORT))
    words = ["run", str(out), "--data", str(data), "--model", str(model), "--structures", "grammar", "peel"]
    words += ["--shares", "0.001", "0.003", "--goals", "in-place", "--trials", "1", "--objects", "1", "--workers", "0"]
    assert study.main(words) == 0
    rows = study.trials_in(out)
    assert len(rows) == 2 * 2 * 2 * 2  # sources, budgets, test trial and diced object, meshes and clouds
    assert {row["status"] for row in rows} == {"done"}
    assert max(row["goal_fragments"] for row in rows) >= 8
    assert all((out / f"anytime-{word}.svg").exists() for word in ("meshes", "point-clouds"))
    capsys.readouterr()
    assert study.main(words) == 0
    assert capsys.readouterr().out.count("already finished: all 1 trials") == 2 * 2 * 2 * 2
    assert [row["digest"] for row in study.trials_in(out)] == [row["digest"] for row in rows]
