"""Foreign goals through `evaluate`: who the donors are, that records are complete, and that a trial can be repeated."""

from typing import get_args

import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.comparison.overlap import Solid, best_match
from cutgrammar.learning.model import load_model
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import read_configurations, read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.storage.split import read_split
from cutgrammar.trials.goals import GOALS
from cutgrammar_pipelines.config import CollectConfig, EvaluateConfig, SplitConfig
from cutgrammar_pipelines.config.options import GoalCondition
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.evaluate.plan_trials import donor_pool
from cutgrammar_pipelines.stages.evaluate.reproduce import reproduce_trials
from cutgrammar_pipelines.stages.splitting import split

METHODS = ("halve", "transfer", "replay", "random")


def test_the_command_line_knows_all_goal_conditions():
    assert get_args(GoalCondition) == GOALS


@pytest.fixture(scope="module")
def carrots(tmp_path_factory):
    """Twelve carrots with the paper's split."""
    folder = tmp_path_factory.mktemp("carrots") / "data"
    collect(CollectConfig(out=folder, trials=12, setups=["N1M1"], foods=["carrot"], workers=0))
    split(SplitConfig([folder], out=folder))
    return folder


def config(data, model, out, **changes):
    given = {"methods": METHODS, "goals": ["foreign"], "runs": 2, "world": "bench", "workers": 0, "trials": 3}
    return EvaluateConfig(data=data, model=[model], out=out, **(given | changes))


@pytest.fixture(scope="module")
def run(carrots, model_folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("foreign") / "run"
    assert evaluate(config(carrots, model_folder, out)).complete
    return out


def test_the_goal_of_every_trial_is_that_of_its_donor_in_all_runs(run, carrots, model_folder):
    source = DataSet.open(carrots)
    known = read_split(source)
    pool = donor_pool(source, known, [load_model(model_folder)], 0)
    records = read_records(ledger_of(run))
    assert len(records) == 3 * (3 + 2)  # all but `random` are deterministic and run once
    for record in records:
        (donor,) = pool.objects("N1M1", record.key.trial, "foreign")
        assert donor.trial in set(known.test) - {record.key.trial}
        assert record.goal_fragments == len(donor.goal)
        shapes = read_configurations(ledger_of(run), record.key)
        theirs = [Solid(fragment.mesh) for fragment in donor.goal]
        scale = (shapes.start[0].mesh.volume / donor.whole.mesh.volume) ** (1 / 3)
        volumes = sorted(fragment.mesh.volume for fragment in shapes.goal)
        assert volumes == pytest.approx(sorted(scale**3 * solid.volume for solid in theirs))
        own = [Solid(fragment.mesh) for fragment in source.demonstration(record.key.trial).goal]
        assert best_match([Solid(fragment.mesh) for fragment in shapes.goal], own).strict < 0.98


def test_the_cuts_of_the_donor_beat_halving_and_no_one_sees_the_goal_as_its_own(run):
    scores = {}
    for record in read_records(ledger_of(run)):
        scores.setdefault(record.key.method, []).append(record.iou_strict)
    means = {method: sum(values) / len(values) for method, values in scores.items()}
    assert means["transfer"] > means["halve"]
    assert means["replay"] < 0.98


def test_trials_with_foreign_goals_can_be_repeated(run, tmp_path):
    records = read_records(ledger_of(run))[:4]
    reproduce_trials(run, [record.key for record in records], tmp_path / "again", workers=0)
    again = {record.key: record.digest for record in read_records(ledger_of(tmp_path / "again"))}
    assert again == {record.key: record.digest for record in records}


def test_an_evaluation_without_donors_is_refused_before_it_begins(carrots, model_folder, tmp_path):
    out = tmp_path / "run"
    with pytest.raises(InputError, match=r"no foreign-food goal: .* an object of another food cut into .* carrot"):
        evaluate(config(carrots, model_folder, out, goals=["foreign-food"]))
    assert not out.exists()
