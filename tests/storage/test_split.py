import json
from collections import Counter
from itertools import cycle

import pytest

from cutgrammar.errors import InputError
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.storage.data_set import DataSet, write_data_set
from cutgrammar.storage.split import Split, make_split, read_split, write_split
from cutgrammar.trials.collection_plan import plan_trials


@pytest.fixture(scope="module")
def made(demonstrate, tmp_path_factory):
    """110 trials in the paper's proportions, each a small one."""
    foods = cycle(["carrot", "potato", "block"])
    out = tmp_path_factory.mktemp("split") / "data"
    demonstrations = [
        demonstrate(p.trial, p.setup.name, p.categories, (next(foods),), cuts=1) for p in plan_trials(110)
    ]
    write_data_set(out, demonstrations, DemonstratorSettings(), 7)
    return out


@pytest.fixture
def data(made):
    for file in made.glob("splits/*"):
        file.unlink()
    return DataSet.open(made)


def test_the_papers_rule_selects_16_of_40_n1m1_trials_for_training_four_of_each_category(data):
    split = make_split(data, "paper")
    assert len(split.train) == 16
    assert {data.summary(trial).setup for trial in split.train} == {"N1M1"}
    categories = Counter(data.summary(trial).categories for trial in split.train)
    assert categories == {("chunks",): 4, ("slices",): 4, ("cubes",): 4, ("strips",): 4}
    assert sorted(split.train + split.test) == list(range(110))
    assert split.train != tuple(range(16)), "the first ones are no random choice"


def test_a_split_depends_only_on_the_summaries_of_the_trials(data):
    assert make_split(data) == make_split(DataSet.open(data.path))
    assert make_split(data).digest == make_split(data, name="mine").digest
    assert make_split(data).digest != make_split(data, "share").digest


def test_a_share_of_every_setup_is_for_training(data):
    split = make_split(data, "share", share=0.5)
    trained = Counter(data.summary(trial).setup for trial in split.train)
    assert trained == {"N1M1": 20, "N1M2": 7, "N2M1": 7, "N2M2": 7, "N2M3": 7, "N3M4": 7}
    assert sorted(split.train + split.test) == list(range(110))


def test_held_out_foods_are_only_in_the_test_set(data):
    split = make_split(data, "food", foods=["carrot"])
    assert {food for trial in split.test for food in data.summary(trial).foods} == {"carrot"}
    assert {food for trial in split.train for food in data.summary(trial).foods} == {"potato", "block"}
    by_default = make_split(data, "food")
    assert {food for trial in by_default.test for food in data.summary(trial).foods} == {"potato"}


@pytest.mark.parametrize("rule", ["paper", "share", "food"])
def test_a_split_survives_writing_and_reading(data, rule):
    split = make_split(data, rule)
    file = write_split(data, split)
    first = file.read_bytes()
    assert read_split(data, rule) == split
    assert write_split(data, split).read_bytes() == first
    assert DataSet.open(data.path).digest == data.digest


def test_missing_trials_are_removed_from_the_split(data, made, tmp_path):
    split = make_split(data)
    write_split(data, split)
    part = made / "cuts" / "part-00000.parquet"
    kept = part.read_bytes()
    try:
        part.unlink()
        left = read_split(DataSet.open(made, allow_missing=True))
    finally:
        part.write_bytes(kept)
    assert left.train == ()
    assert left.test == tuple(range(50, 110))


def changed(data, facts):
    file = write_split(data, make_split(data))
    file.write_text(json.dumps({k: v for k, v in (json.loads(file.read_text()) | facts).items() if v is not None}))
    return data


def test_invalid_split_files_are_refused_with_one_line(data):
    with pytest.raises(InputError, match="has no split 'paper'; cutgrammar split makes one"):
        read_split(data)
    write_split(data, make_split(data, "share"))
    with pytest.raises(InputError, match="has no split 'paper'; it has share; cutgrammar split makes one"):
        read_split(data)
    for facts, message in (
        ({"train": [3, 400]}, "has trial 400, which is not in the data set"),
        ({"train": [3], "test": [2, 3]}, "trial 3 is both a training and a test trial"),
        ({"train": [3, 3], "test": [2]}, "has a trial twice"),
        ({"train": [3.5]}, r"train\[0\] = 3.5 is not a whole number"),
        ({"test": None}, "test is missing"),
        ({"data": "0" * 64}, "was made for another data set"),
        ({"schema": 9}, "has schema 9, not 1"),
    ):
        with pytest.raises(InputError, match=message):
            read_split(changed(data, facts))
    for torn in ("", "[", "\udcff"):
        (data.path / "splits" / "paper.json").write_bytes(torn.encode(errors="surrogateescape"))
        with pytest.raises(InputError, match=r"paper.json is damaged"):
            read_split(data)
    (data.path / "splits" / "paper.json").write_text("[]")
    with pytest.raises(InputError, match="has schema None"):
        read_split(data)


def test_impossible_splits_are_refused_with_one_line(data, demonstrate, tmp_path):
    with pytest.raises(InputError, match="rule 'half' is unknown; known: paper, share, food"):
        make_split(data, "half")
    with pytest.raises(InputError, match="share 1.5 of training trials"):
        make_split(data, "share", share=1.5)
    with pytest.raises(InputError, match="food 'lemon' is unknown; known: block, carrot, potato"):
        make_split(data, "food", foods=["lemon"])
    with pytest.raises(InputError, match="is not a valid file name"):
        write_split(data, make_split(data, name="../x"))
    with pytest.raises(InputError, match="both a training and a test trial"):
        write_split(data, Split("a", "mine", (1,), (1,)))
    write_data_set(tmp_path / "one", [demonstrate(setup="N2M1", cuts=1)], DemonstratorSettings(), 7)
    with pytest.raises(InputError, match="leaves no training trial"):
        make_split(DataSet.open(tmp_path / "one"))
    write_data_set(tmp_path / "two", [demonstrate(cuts=1)], DemonstratorSettings(), 7)
    with pytest.raises(InputError, match="leaves no test trial"):
        make_split(DataSet.open(tmp_path / "two"))
