"""`show --out` draws data sets, models and runs, and refuses what it cannot draw in one line."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar.learning.model import load_model
from cutgrammar.learning.typical_fragments import typical_fragments
from cutgrammar.storage.data_set import DataSet
from cutgrammar_pipelines.config import ShowConfig
from cutgrammar_pipelines.inspection import chosen_trials
from cutgrammar_pipelines.inspection.pictures import picture_of_data, pictures_of_model, training_trials_of
from cutgrammar_pipelines.inspection.show import show


def test_a_data_set_is_drawn(data_folder, tmp_path, capsys):
    assert show(ShowConfig(data_folder, out=tmp_path / "data.svg")) == 0
    assert (tmp_path / "data.svg").read_bytes().startswith(b"<?xml")
    assert capsys.readouterr().out == f"{tmp_path / 'data.svg'}\n"


def test_types_are_shown_by_training_fragments_of_these_types(data_folder, model_folder):
    model = load_model(model_folder)
    demonstrations = training_trials_of(model, model_folder)
    typical = typical_fragments(model, demonstrations)
    assert len(typical) == model.grammar.k
    assert {one.trial for one in typical} <= set(model.provenance.trials)
    assert sum(one.count for one in typical) == model.metrics["fragments"]
    for c, one in enumerate(typical):
        assert 0.001 < one.length < 0.5
        if one.count:
            assert model.classifier.log_probabilities(model.features(one.mesh)).argmax() == c


def test_a_model_is_drawn_reproducibly_with_the_data_set_found_beside_it(model_folder, tmp_path):
    drawn = [pictures_of_model(model_folder, tmp_path / name) for name in ("once", "again")]
    assert [file.name for file in drawn[0]] == ["grammar.png", "induction.png"]
    assert [file.read_bytes() for file in drawn[0]] == [file.read_bytes() for file in drawn[1]]


def test_a_model_in_another_place_than_its_data_set_needs_its_path(data_folder, model_folder, tmp_path):
    far = tmp_path / "far" / "away" / "model"
    shutil.copytree(model_folder, far)
    with pytest.raises(InputError, match=r"is not in a folder beside it; name it with --data"):
        show(ShowConfig(far, out=tmp_path / "grammar.png"))
    assert show(ShowConfig(far, out=tmp_path / "grammar.png", data=data_folder)) == 0


def test_another_data_set_is_refused(model_folder, tmp_path, made_data):
    with pytest.raises(InputError, match="is not the data set that"):
        show(ShowConfig(model_folder, out=tmp_path / "grammar.png", data=made_data))


@pytest.fixture
def made_data(tmp_path):
    from cutgrammar_pipelines import CollectConfig, collect

    collect(CollectConfig(out=tmp_path / "other", trials=1, setups=["N1M1"], seed=4, workers=0))
    return tmp_path / "other"


def test_a_wrong_suffix_is_refused_before_any_work(data_folder, model_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(DataSet, "open", None)
    for draw in (picture_of_data, pictures_of_model):
        with pytest.raises(InputError, match=r"a\.pdf is not the name of a picture"):
            draw(data_folder, tmp_path / "a.pdf")


def test_data_without_a_model_to_draw_is_refused(data_folder, tmp_path):
    with pytest.raises(InputError, match="give a model and --out too"):
        show(ShowConfig(data_folder, out=tmp_path / "a.png", data=data_folder))


def test_a_run_needs_a_folder(scored_run, tmp_path):
    with pytest.raises(InputError, match=r"is a file name, but a run has several pictures; give a folder"):
        show(ShowConfig(scored_run, out=tmp_path / "a.png"))


def test_of_each_setup_the_median_trial_of_grammar_is_drawn_under_all_methods(made):
    facts = made.facts_of()
    records = made.records_of(facts, trials=3, goals=("scattered", "in-place"))
    one = chosen_trials.one_condition(records)
    assert {(r.key.goals, r.key.run) for r in one} == {("in-place", 0)}
    rows = chosen_trials.median_trials(one)
    assert [row[0].key.setup for row in rows] == list(made.setups)
    for row in rows:
        assert [r.key.method for r in row] == ["grammar", "largest", "random", "replay"]
        assert len({r.key.trial for r in row}) == 1
        mine = [r for r in one if r.key.method == "grammar" and r.key.setup == row[0].key.setup]
        below = sum(r.iou_strict < row[0].iou_strict for r in mine)
        assert below == 1


def test_the_matching_with_unmatched_fragments_is_drawn_if_there_is_one(made):
    records = made.records_of(made.facts_of())
    even = [replace(record, fragments=record.goal_fragments) for record in records]
    assert chosen_trials.uneven_matching(even).key.method == "grammar"
    odd = replace(even[5], fragments=even[5].goal_fragments - 2)
    assert chosen_trials.uneven_matching([*even[:5], odd, *even[6:]]) == odd


@pytest.mark.slow
def test_a_run_is_drawn(data_folder, model_folder, quick_settings, tmp_path, capsys):
    from cutgrammar_pipelines import EvaluateConfig, evaluate

    evaluate(
        EvaluateConfig(
            data=data_folder,
            model=model_folder,
            out=tmp_path / "run",
            methods=["grammar", "random"],
            runs=1,
            trials=1,
            world="bench",
            workers=0,
            settings=quick_settings,
        )
    )
    capsys.readouterr()
    assert show(ShowConfig(tmp_path / "run", out=tmp_path / "pictures")) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert {"2-inference.png", "4-methods.png", "5-matched.png"} <= {file.name for file in files}
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files)
