import dataclasses
import os
import shutil

import pytest

from cutgrammar import plugins
from cutgrammar.errors import InputError
from cutgrammar.learning.model import load_model, save_model
from cutgrammar.settings import DemonstratorSettings, InductionSettings, SearchSettings, Settings
from cutgrammar.storage.data_set import DataSet, write_data_set
from cutgrammar.storage.ledger import Ledger, read_planned, read_records
from cutgrammar.storage.run_folder import ledger_of, read_run, recording_of
from cutgrammar.storage.split import Split, read_split, write_split
from cutgrammar_pipelines.stages.evaluate.reproduce import reproduce_trial, reproduce_trials
from quick_runs import digests, run_quick
from untrained_model import untrained


@pytest.fixture(scope="module")
def repeated(given, tmp_path_factory):
    """Three models that repeat one training with the seeds 0, 1 and 2."""
    folder = tmp_path_factory.mktemp("repeated")
    data = DataSet.open(given / "data")
    for seed in range(3):
        save_model(untrained(data, read_split(data), seed), folder / f"model-{seed}")
    return [folder / f"model-{seed}" for seed in range(3)]


def test_every_planned_trial_has_a_record(given, run):
    summary = run_quick(given, run, setups=None, goals=["in-place", "scattered"])
    assert (summary.planned, summary.present, summary.new) == (4, 4, 4)
    assert summary.complete
    records = read_records(ledger_of(run))
    assert [record.key for record in records] == read_planned(ledger_of(run))
    tests = read_split(DataSet.open(given / "data")).test
    assert {record.key.trial for record in records} <= set(tests)
    assert {record.key.setup for record in records} == {"N1M1", "N1M2"}
    assert all(record.iou_strict > 0.0 for record in records)


def test_evaluating_a_finished_run_changes_nothing_and_says_so(given, run, capsys):
    run_quick(given, run)
    before = {path: path.read_bytes() for path in run.iterdir()}
    capsys.readouterr()
    summary = run_quick(given, run)
    assert summary.new == 0
    assert "already finished: all 1 trials have a record" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in run.iterdir()} == before


def test_added_methods_setups_and_runs_cost_only_their_own_trials(given, run, tmp_path):
    assert run_quick(given, run).new == 1
    assert run_quick(given, run, setups=["N1M1", "N1M2"]).new == 1
    assert run_quick(given, run, runs=2).new == 1
    assert run_quick(given, run, methods=["largest", "random"]).new == 1
    run_quick(given, tmp_path / "at once", methods=["largest", "random"], runs=2)
    both = digests(run).items() & digests(tmp_path / "at once").items()
    assert len(both) == 3


def test_run_json_holds_what_all_trials_have_in_common(given, run):
    run_quick(given, run, seed=3)
    facts = read_run(run)
    assert (facts.seed, facts.split, facts.data) == (3, "paper", str((given / "data").resolve()))
    assert facts.data_digest == DataSet.open(given / "data").digest
    assert facts.model_digests == (load_model(given / "model").digest,)
    assert facts.settings["trial"] == {"max_refusals": 10, "max_seconds": 3600.0}
    assert facts.machine["cpus"] == os.cpu_count()


def test_another_seed_or_other_settings_are_refused_in_an_existing_run(given, run):
    run_quick(given, run)
    with pytest.raises(InputError, match="started with seed = 0, not 1"):
        run_quick(given, run, seed=1)
    with pytest.raises(InputError, match=r"started with settings\.search\.n_searches = \d+, not 99"):
        run_quick(given, run, settings=Settings(search=SearchSettings(n_searches=99)))
    assert len(digests(run)) == 1


def test_another_seed_gives_other_results(given, run, tmp_path):
    run_quick(given, run)
    run_quick(given, tmp_path / "other", seed=1)
    ious = [[r.scores for r in read_records(ledger_of(folder))] for folder in (run, tmp_path / "other")]
    assert ious[0] != ious[1]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"setups": ["N3M4"]}, r"setup N3M4 has no test trials .* setups with test trials: N1M1, N1M2"),
        ({"split": "mine"}, r"has no split 'mine'"),
        ({"perception": "cameras"}, r"has no segmentation, .* train one with: cutgrammar train --vision"),
    ],
)
def test_a_config_that_does_not_fit_the_data_is_refused_in_one_line_and_leaves_no_folder(given, run, changes, words):
    with pytest.raises(InputError, match=words) as caught:
        run_quick(given, run, **changes)
    assert "\n" not in str(caught.value)
    assert not run.exists()


def test_a_goal_with_fewer_fragments_than_its_start_is_named(given, run, tmp_path):
    source = DataSet.open(given / "data")
    whole = source.demonstration(0)
    two = dataclasses.replace(
        whole,
        trial=1,
        foods=whole.foods * 2,
        fragments=(whole.fragments[0], dataclasses.replace(whole.fragments[0], id=1, category="slices")),
        poses={(0, 0): whole.poses[0, 0], (0, 1): whole.poses[0, 0], (1, 1): whole.poses[0, 0]},
        cuts=(),
    )
    write_data_set(tmp_path / "data", [whole, two], DemonstratorSettings(), 0)
    data = DataSet.open(tmp_path / "data")
    write_split(data, Split("paper", "paper", (0,), (1,)))
    with pytest.raises(InputError, match=r"trial 1 of .*: its goal has 1 fragments and its start 2"):
        run_quick(given, run, data=tmp_path / "data")


def test_a_model_is_not_tested_on_its_training_trials(given, run, tmp_path):
    data = DataSet.open(given / "data")
    paper = read_split(data)
    save_model(untrained(data, dataclasses.replace(paper, train=paper.test)), tmp_path / "model")
    with pytest.raises(InputError, match=r"trial \d+ is a test trial of .*, but the model was trained on it"):
        run_quick(given, run, model=tmp_path / "model")


def test_every_run_uses_its_own_model_as_if_it_were_evaluated_alone(given, repeated, run, tmp_path):
    several = {"methods": ["grammar", "random"], "runs": None}
    assert run_quick(given, run, model=repeated, **several).planned == 2 * 3
    facts, records = read_run(run), read_records(ledger_of(run))
    assert facts.model_digests == tuple(load_model(path).digest for path in repeated)
    for record in records:
        assert record.model == facts.model_digests[record.key.run]
        assert record.key.origin == facts.origins[record.key.run]
    assert run_quick(given, run, model=repeated, **several).new == 0
    run_quick(given, tmp_path / "first", model=repeated[0], methods=["grammar"], runs=1)
    assert digests(tmp_path / "first").items() <= digests(run).items()
    planned = [
        [e["plane_W"] for e in r.events if e["event"] == "Planned"] for r in records if r.key.method == "grammar"
    ]
    assert planned[0] != planned[1] != planned[2]


def test_a_trial_that_nothing_random_decides_is_carried_out_once_for_all_runs(given, repeated, run):
    assert run_quick(given, run, model=repeated, runs=None, methods=["halve", "random"]).planned == 1 + 3
    assert [record.key.run for record in read_records(ledger_of(run)) if record.key.method == "halve"] == [0]
    assert run_quick(given, run, model=repeated, runs=None, methods=["halve"], world="board", trials=1).planned == 3


def test_trials_of_several_models_are_reproduced_with_the_model_of_their_run(given, repeated, run, tmp_path):
    run_quick(given, run, model=repeated, runs=None, methods=["grammar"])
    keys = [record.key for record in read_records(ledger_of(run))]
    reproduce_trials(run, keys[1:], tmp_path / "again", workers=0)
    assert digests(tmp_path / "again").items() < digests(run).items()
    (repeated[2] / "model.json").rename(repeated[2] / "gone")
    reproduce_trials(run, keys[:1], tmp_path / "one", workers=0)  # the models of other runs are not needed
    with pytest.raises(InputError, match="is not a model"):
        reproduce_trials(run, keys[2:], tmp_path / "other", workers=0)
    (repeated[2] / "gone").rename(repeated[2] / "model.json")


def test_models_that_are_no_repetitions_of_one_training_are_refused(given, repeated, run, tmp_path):
    data = DataSet.open(given / "data")
    split = read_split(data)
    fewer = untrained(data, dataclasses.replace(split, train=split.train[:1]), 3)
    other = dataclasses.replace(untrained(data, split, 3), settings=Settings(induction=InductionSettings(fixed_k=2)))
    for name, model in (("fewer", fewer), ("other", other)):
        save_model(model, tmp_path / name)
    several = {"runs": None, "methods": ["random"]}
    with pytest.raises(InputError, match=r"no repetitions of one training: split_digest = .*; evaluate them into"):
        run_quick(given, run, model=[repeated[0], tmp_path / "fewer"], **several)
    with pytest.raises(InputError, match=r"no repetitions of one training: settings\.induction\.fixed_k = 0, not 2"):
        run_quick(given, run, model=[repeated[0], tmp_path / "other"], **several)
    with pytest.raises(InputError, match="hold the same model; give each once, or one with --runs"):
        run_quick(given, run, model=[repeated[0], repeated[0]], **several)
    with pytest.raises(InputError, match="missing does not exist"):
        run_quick(given, run, model=[repeated[0], tmp_path / "missing"], **several)
    with pytest.raises(ValueError, match=r"runs 2 do not go with 3 models, each of which is one run"):
        run_quick(given, run, model=repeated, runs=2)
    assert not run.exists()
    run_quick(given, run, model=repeated[:2], **several)
    with pytest.raises(InputError, match=r"was started with model_digests\.2 = None, not "):
        run_quick(given, run, model=repeated, **several)


def test_a_run_in_use_is_refused(given, run):
    run_quick(given, run)
    with Ledger(ledger_of(run)), pytest.raises(InputError, match="is being evaluated by another process"):
        run_quick(given, run)


def test_a_method_is_evaluated_only_on_goals_that_it_applies_to(given, run, capsys):
    both = ["in-place", "scattered"]
    summary = run_quick(given, run, methods=["copy", "random"], goals=both)
    assert summary.complete
    tried = {(record.key.method, record.key.goals) for record in read_records(ledger_of(run))}
    assert tried == {("copy", "in-place"), ("random", "in-place"), ("random", "scattered")}
    assert "NOTE copy does not apply to scattered goals and is not evaluated on them" in capsys.readouterr().err
    assert run_quick(given, run, methods=["copy", "random"], goals=both).new == 0


def test_goals_that_no_method_applies_to_are_refused(given, run):
    with pytest.raises(InputError, match=r"copy cannot be evaluated on scattered goals.*give other goals \(in-place"):
        run_quick(given, run, methods=["copy"], goals=["scattered"])
    assert not run.exists()


@pytest.mark.slow
def test_all_methods_finish_and_the_replayed_demonstration_wins(given, run):
    run_quick(given, run, methods=None, setups=None)
    records = read_records(ledger_of(run))
    assert {record.key.method for record in records} == set(plugins.names_in(plugins.METHODS)) - {"human", "transfer"}
    assert all(record.iou_strict >= 0.98 for record in records if record.key.method == "replay")
    assert not any(record.status == "crashed" for record in records)


@pytest.mark.slow
def test_a_reproduced_trial_has_the_same_result(given, run):
    run_quick(given, run, methods=["random", "largest"], record="all")
    for record in read_records(ledger_of(run)):
        assert recording_of(run, record.key.name).stat().st_size > 10_000
    again = reproduce_trial(run, record.key)
    assert again.record.digest == record.digest
    assert again.recording is not None
    facts = (run / "run.json").read_text()
    (run / "run.json").write_text(facts.replace('"max_refusals": 10', '"max_refusals": 9'))
    with pytest.raises(InputError, match=r"run\.json was changed since; put a good copy"):
        reproduce_trial(run, record.key)
    (run / "run.json").write_text(facts.replace(DataSet.open(given / "data").digest, 64 * "0"))
    with pytest.raises(InputError, match="was made with data_digest = 0.*; put back this data set, model and"):
        reproduce_trial(run, record.key)
    shutil.rmtree(run)
    run_quick(given, run, record="failed")
    assert not (run / "recordings").exists()


@pytest.mark.slow
def test_results_do_not_depend_on_workers_and_planners(given, run, tmp_path):
    few = {"methods": ["grammar", "random"], "setups": None}
    run_quick(given, run, **few)
    run_quick(given, tmp_path / "two", workers=2, **few)
    run_quick(given, tmp_path / "planners", workers=2, planners=2, **few)
    assert digests(run) == digests(tmp_path / "two") == digests(tmp_path / "planners")


def test_reproduced_trials_of_a_run_have_the_same_results_and_are_carried_out_once(given, run, tmp_path):
    run_quick(given, run, runs=2, methods=["random", "largest"])
    drawn = [record.key for record in read_records(ledger_of(run))][::2]
    for _ in range(2):
        reproduce_trials(run, drawn, tmp_path / "again", workers=0)
    before, after = digests(run), digests(tmp_path / "again")
    assert len(after) == len(drawn) == 2
    assert after.items() <= before.items()
