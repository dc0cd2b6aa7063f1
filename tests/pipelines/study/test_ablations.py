import json

import pytest

from cutgrammar.errors import InputError
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar_pipelines.config import StudyConfig
from cutgrammar_pipelines.study.run import study

STUDY = """
[study]
seed = 3
[collect]
trials = 14
setups = ["N1M1", "N1M2"]
[evaluate]
setups = ["N1M1", "N1M2"]
methods = ["grammar", "largest", "oracle-types", "oracle-parse", "oracle-planes"]
world = "bench"
runs = 1
trials = 1
[[variants]]
name = "k-2"
question = "number of fragment types"
settings = { induction = { max_k = 2, fixed_k = 2 } }
[[variants]]
name = "one-rollout"
question = "rollouts"
settings = { search = { max_rounds = 1 } }
[[variants]]
name = "train-2"
question = "training trials"
train_trials = 2
methods = ["largest"]
[[transfers]]
name = "carrots-to-potatoes"
trials = 5
test_trials = 1
"""


@pytest.mark.slow
def test_a_study_with_variants_summarises_them_and_does_nothing_the_second_time(
    tmp_path, quick_settings, monkeypatch, capsys
):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    file, out = tmp_path / "study.toml", tmp_path / "out"
    file.write_text(f"{quick_settings.read_text()}\n{STUDY}")
    config = StudyConfig(out=out, settings=file, workers=0)
    assert study(config) == 0
    summary = json.loads((out / "ablations.json").read_text())
    rows = {(row["variant"], row["method"]): row for row in summary["rows"]}
    assert rows["k-2", "grammar"]["k"] == 2
    assert rows["train-2", "largest"]["training_trials"] == 2
    assert rows["train-2", "largest"]["mean_difference"] == 0.0  # what is not learned does not change
    assert read_run(out / "ablations" / "runs" / "one-rollout").model_digests == read_run(out / "run").model_digests
    for name in ("k-2", "one-rollout"):
        records = read_records(ledger_of(out / "ablations" / "runs" / name))
        assert [record.key.setup for record in records] == ["N1M1", "N1M2"]
    assert [row["setup"] for row in summary["oracles"]] == ["N1M1", "N1M2", "all"]
    assert [row["tested"] for row in summary["transfers"]] == ["carrot", "potato"]
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file() and path.suffix != ".lock"}
    capsys.readouterr()
    assert study(config) == 0
    assert capsys.readouterr().out.count("already finished: all") == 6
    assert {path: path.read_bytes() for path in before} == before


def test_a_study_refuses_unknown_methods_of_variants_before_it_begins(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text('[study]\n[[variants]]\nname = "a"\nmethods = ["wishing"]\n')
    with pytest.raises(InputError, match="method 'wishing' is unknown"):
        study(StudyConfig(out=tmp_path / "out", settings=file, workers=0))
    assert not (tmp_path / "out").exists()
