import pytest

from cutgrammar.errors import InputError
from cutgrammar_pipelines.study.settings import load_study, preset_file
from cutgrammar_pipelines.study.variants import load_variations


@pytest.fixture
def file(tmp_path):
    def write(text):
        (tmp_path / "mine.toml").write_text(text)
        return tmp_path / "mine.toml"

    return write


def test_the_preset_of_ablations_asks_every_question_and_agrees_with_that_of_the_paper():
    own, settings = load_study(preset_file("ablations"))
    paper, paper_settings = load_study(preset_file("paper"))
    assert (own.seed, own.trials, own.setups, own.world) == (paper.seed, paper.trials, paper.setups, paper.world)
    assert settings == paper_settings
    variations = load_variations(preset_file("ablations"))
    assert {variant.asked.question for variant in variations.variants} == {
        "number of fragment types",
        "rollouts",
        "annealing",
        "plane head",
        "training seed",
        "training trials",
    }
    assert set(variations.methods) <= {*own.methods, *variations.transfers[0].methods}
    rollouts = [v.settings.search for v in variations.variants if v.asked.question == "rollouts"]
    assert [search.n_searches * search.max_rounds for search in rollouts] == [1, 20, 50, 800]  # the study's own are 200
    assert [v.settings.induction.fixed_k for v in variations.variants][:4] == [4, 8, 16, 32]


def test_presets_without_variants_have_none():
    assert not load_variations(preset_file("demo"))


def test_a_variant_changes_what_it_names_and_keeps_the_rest_of_the_study(file):
    asked = file(
        "[study]\nseed = 3\n[search]\nmax_rounds = 7\nlayout_length_scale = 2.0\n[planes]\nn_components = 3\n"
        '[[variants]]\nname = "few"\nquestion = "rollouts"\nsettings = { search = { max_rounds = 2 } }\n'
    )
    (variant,) = load_variations(asked).variants
    assert (variant.settings.search.max_rounds, variant.settings.search.layout_length_scale) == (2, 2.0)
    assert variant.settings.planes.n_components == 3
    assert variant.changes == {"search.max_rounds": 2}
    assert load_study(asked)[1].search.max_rounds == 7


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('variants = "all"', r"variants must be tables in double brackets, e.g. \[\[variants\]\], not 'all'"),
        ("variants = [1]", "variant 1 must be a table, not 1"),
        ('[[variants]]\nquestion = "q"', "variant 1: name '' cannot be a folder's"),
        ('[[variants]]\nname = "a/b"', "name 'a/b' cannot be a folder's"),
        ('[[variants]]\nname = "a"\nrounds = 3', r"variant 1: unknown setting rounds.* \(known: name, question"),
        (
            '[[variants]]\nname = "a"\nsettings = { search = { max_round = 3 } }',
            r"variant 1 \(a\), settings: unknown setting search.max_round; did you mean max_rounds",
        ),
        ('[[variants]]\nname = "a"\ntrain_trials = -1', "train_trials = -1 is too small; the minimum is 0"),
        ('[[variants]]\nname = "a"\n[[transfers]]\nname = "a"', "two variants or transfers are called 'a'"),
        (
            '[[transfers]]\nname = "a"\ntrain_foods = ["potato"]',
            "transfer 'a' trains on 'potato' and tests it as another food",
        ),
    ],
)
def test_what_is_wrong_with_a_variant_is_told_in_one_line(file, text, message):
    with pytest.raises(InputError, match=message):
        load_variations(file(text))
