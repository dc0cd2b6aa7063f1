import shutil

import pytest

from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.config import CollectConfig
from cutgrammar_pipelines.stages.training_data import OTHER_FOOD, SAME_FOOD, transfer_data, with_training_trials
from cutgrammar_pipelines.study.variants import Transfer


@pytest.fixture
def data(data_folder, tmp_path):
    return shutil.copytree(data_folder, tmp_path / "data")


def chosen(data, number, tmp_path):
    collected = CollectConfig(out=data, seed=3, workers=0)
    folder, name = with_training_trials(collected, number, tmp_path / "more")
    return DataSet.open(folder), read_split(DataSet.open(folder), name)


def test_the_number_of_the_split_needs_no_new_data(data, tmp_path):
    known = read_split(DataSet.open(data))
    for number in (0, len(known.train)):
        source, split = chosen(data, number, tmp_path)
        assert (source.path, split) == (data, known)
    assert not (tmp_path / "more").exists()


def test_a_smaller_training_set_is_part_of_a_larger_one_and_both_test_the_same(data, tmp_path):
    known = read_split(DataSet.open(data))
    one, two = (chosen(data, number, tmp_path)[1] for number in (1, 2))
    assert (len(one.train), len(two.train)) == (1, 2)
    assert set(one.train) < set(two.train) <= set(known.train)
    assert one.test == two.test == known.test


def test_further_training_trials_are_added_and_all_others_keep_their_numbers_and_shapes(data, tmp_path):
    before, known = DataSet.open(data), read_split(DataSet.open(data))
    after, split = chosen(data, len(known.train) + 2, tmp_path)
    assert split.test == known.test
    assert split.train == (*known.train, len(before.trials), len(before.trials) + 1)
    for trial in (known.train[0], known.test[-1]):
        assert after.tables(trial)["fragments"].equals(before.tables(trial)["fragments"])
    assert {after.summary(trial).setup for trial in split.train} == {"N1M1"}
    assert {after.summary(trial).seed for trial in split.train} == {3, 1003}
    assert chosen(data, len(known.train) + 2, tmp_path)[0].digest == after.digest


def test_a_transfer_trains_on_some_foods_and_tests_them_and_others_separately(tmp_path):
    collected = CollectConfig(out=tmp_path / "data", workers=0)
    data = DataSet.open(transfer_data(collected, Transfer(name="t", trials=5), tmp_path))
    same, other = read_split(data, SAME_FOOD), read_split(data, OTHER_FOOD)
    assert same.train == other.train
    assert len(same.train) == 2
    foods = [{food for trial in trials for food in data.summary(trial).foods} for trials in (same.train, same.test)]
    assert foods == [{"carrot"}, {"carrot"}]
    assert {food for trial in other.test for food in data.summary(trial).foods} == {"potato"}
    assert len(other.test) == 5
