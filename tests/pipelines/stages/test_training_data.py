import shutil

import pytest

from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.stages.training_data import OTHER_FOOD, SAME_FOOD, transfer_data, with_training_trials
from cutgrammar_pipelines.study.variants import Transfer


@pytest.fixture
def data(data_folder, tmp_path):
    return shutil.copytree(data_folder, tmp_path / "data")


def chosen(data, number, tmp_path):
    folder, name = with_training_trials(data, number, tmp_path / "more", seed=3, workers=0)
    return DataSet.open(folder), read_split(DataSet.open(folder), name)


def test_as_many_training_trials_as_there_are_need_nothing_new(data, tmp_path):
    known = read_split(DataSet.open(data))
    for number in (0, len(known.train)):
        source, split = chosen(data, number, tmp_path)
        assert (source.path, split) == (data, known)
    assert not (tmp_path / "more").exists()


def test_fewer_training_trials_lie_within_more_and_test_the_same(data, tmp_path):
    known = read_split(DataSet.open(data))
    one, two = (chosen(data, number, tmp_path)[1] for number in (1, 2))
    assert (len(one.train), len(two.train)) == (1, 2)
    assert set(one.train) < set(two.train) <= set(known.train)
    assert one.test == two.test == known.test


def test_more_training_trials_are_added_and_the_others_keep_number_and_shape(data, tmp_path):
    before, known = DataSet.open(data), read_split(DataSet.open(data))
    after, split = chosen(data, len(known.train) + 2, tmp_path)
    assert split.test == known.test
    assert split.train == (*known.train, len(before.trials), len(before.trials) + 1)
    for trial in (known.train[0], known.test[-1]):
        assert after.tables(trial)["fragments"].equals(before.tables(trial)["fragments"])
    assert {after.summary(trial).setup for trial in split.train} == {"N1M1"}
    assert {after.summary(trial).seed for trial in split.train} == {3, 1003}
    assert chosen(data, len(known.train) + 2, tmp_path)[0].digest == after.digest


def test_a_transfer_trains_on_some_foods_and_tests_them_and_others_apart(tmp_path):
    asked = Transfer(name="t", trials=5)
    data = DataSet.open(transfer_data(asked, tmp_path, seed=0, workers=0, settings=Settings()))
    same, other = read_split(data, SAME_FOOD), read_split(data, OTHER_FOOD)
    assert same.train == other.train
    assert len(same.train) == 2
    foods = [{food for trial in trials for food in data.summary(trial).foods} for trials in (same.train, same.test)]
    assert foods == [{"carrot"}, {"carrot"}]
    assert {food for trial in other.test for food in data.summary(trial).foods} == {"potato"}
    assert len(other.test) == 5
