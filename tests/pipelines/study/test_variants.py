from dataclasses import replace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.plugins import METHODS, names_in
from cutgrammar_pipelines.config import StudyConfig
from cutgrammar_pipelines.study.study_file import load_study


@pytest.fixture
def file(tmp_path):
    def write(text):
        (tmp_path / "mine.toml").write_text(text)
        return tmp_path / "mine.toml"

    return write


def preset(name):
    return load_study(StudyConfig(preset=name))


def test_the_preset_ablations_has_variants_for_every_question_and_agrees_with_the_preset_paper():
    study, paper = preset("ablations"), preset("paper")
    assert study.collect == paper.collect
    assert study.train == replace(paper.train, out=study.train.out)
    assert study.evaluate.world == paper.evaluate.world
    assert {variant.options.question for variant in study.variations.variants} == {
        "number of fragment types",
        "rollouts",
        "annealing",
        "plane head",
        "training seed",
        "training trials",
        "what grammar-plus adds",
    }
    rollouts = [v.settings.search for v in study.variations.variants if v.options.question == "rollouts"]
    assert [search.n_searches * search.max_rounds for search in rollouts] == [1, 20, 50, 800]  # the study's own are 200
    assert [v.settings.induction.fixed_k for v in study.variations.variants][:4] == [4, 8, 16, 32]


def test_presets_without_variants_have_none():
    assert not preset("demo").variations


def test_a_study_of_several_models_trains_each_with_a_seed_of_its_own_and_evaluates_all(file):
    study = load_study(StudyConfig(out="o", settings=file("[study]\nseed = 7\nmodels = 3\n")))
    assert [training.seed for training in study.trainings] == [7, 8, 9]
    assert [str(training.out) for training in study.trainings] == ["o/model-0", "o/model-1", "o/model-2"]
    assert study.evaluate.model == tuple(str(training.out) for training in study.trainings)
    assert study.evaluate.n_runs == 3
    alone = load_study(StudyConfig(out="o", settings=file("[study]\nseed = 7\n")))
    assert [str(training.out) for training in alone.trainings] == ["o/model"]
    assert alone.evaluate.n_runs == 5
    with pytest.raises(InputError, match="runs 2 do not go with 3 models"):
        load_study(StudyConfig(settings=file("[study]\nmodels = 3\n[evaluate]\nruns = 2\n")))


def test_the_preset_paper_has_every_method_but_oracles_and_people_and_the_presets_of_data_seeds_agree_with_it():
    paper = preset("paper")
    elsewhere = {name for name in names_in(METHODS) if name.startswith("oracle") or name == "human"}
    assert set(paper.evaluate.methods) == set(names_in(METHODS)) - elsewhere
    assert len(paper.trainings) == preset("seeds").evaluate.n_runs == 5
    assert preset("seeds").train.settings == paper.train.settings
    assert set(preset("seeds").evaluate.methods) < set(paper.evaluate.methods)


def test_a_variant_changes_what_it_names_and_keeps_the_rest_of_the_study(file):
    text = (
        "[study]\nseed = 3\n[search]\nmax_rounds = 7\nlayout_length_scale = 2.0\n[planes]\nn_components = 3\n"
        '[[variants]]\nname = "few"\nquestion = "rollouts"\nsettings = { search = { max_rounds = 2 } }\n'
    )
    study = load_study(StudyConfig(settings=file(text)))
    (variant,) = study.variations.variants
    assert (variant.settings.search.max_rounds, variant.settings.search.layout_length_scale) == (2, 2.0)
    assert variant.settings.planes.n_components == 3
    assert variant.changes == {"search.max_rounds": 2}
    assert study.settings.search.max_rounds == 7
    assert study.train.seed == study.collect.seed == study.evaluate.seed == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[evaluate]\nout = 'x'", "unknown setting evaluate.out; known: methods, human, setups, runs"),
        ("[evaluate]\ntest_robots = true", "unknown setting evaluate.test_robots"),
        ("[evaluate]\nrun = 3", "unknown setting evaluate.run; .*; did you mean runs"),
        ("[evaluate]\nruns = '3'", "evaluate.runs = '3' is not a whole number"),
        ("[evaluate]\nmethods = ['gramar']", "method 'gramar' is unknown; .*; did you mean grammar"),
        ("collect = 3", "collect. must be a table, not 3|collect must be a table, not 3"),
        ('variants = "all"', r"variants must be tables in double brackets, e.g. \[\[variants\]\], not 'all'"),
        ("variants = [1]", "variant 1 must be a table, not 1"),
        ('[[variants]]\nquestion = "q"', "variant 1: name '' cannot be a folder's"),
        ('[[variants]]\nname = "a/b"', "name 'a/b' cannot be a folder's"),
        ('[[variants]]\nname = "a"\nrounds = 3', r"variant 1: unknown setting rounds; known: name, question"),
        (
            '[[variants]]\nname = "a"\nsettings = { search = { max_round = 3 } }',
            r"variant 1 \(a\), settings: unknown setting search.max_round; .*; did you mean max_rounds",
        ),
        ('[[variants]]\nname = "a"\ntrain_trials = -1', "train_trials = -1 is too small; the minimum is 0"),
        ('[[variants]]\nname = "a"\n[[transfers]]\nname = "a"', "two variants or transfers are called 'a'"),
        (
            '[[transfers]]\nname = "a"\ntrain_foods = ["potato"]',
            "transfer 'a' trains on 'potato' and tests it as another food",
        ),
    ],
)
def test_an_error_in_a_study_file_is_one_line(file, text, message):
    with pytest.raises(InputError, match=message):
        load_study(StudyConfig(settings=file(text)))
