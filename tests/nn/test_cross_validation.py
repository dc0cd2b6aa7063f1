import numpy as np
import pytest

from cutgrammar.nn.cross_validation import best_epoch, grouped_folds


def test_folds_never_divide_a_group_and_hold_out_every_row_once(rng):
    groups = rng.integers(7, size=100)
    folds = grouped_folds(groups, 4, rng)
    assert len(folds) == 4
    for fit, held in folds:
        assert not set(groups[fit]) & set(groups[held])
        assert sorted([*fit, *held]) == list(range(100))
    assert sorted(np.concatenate([held for _, held in folds])) == list(range(100))


def test_one_group_cannot_be_held_out(rng):
    assert grouped_folds(np.zeros(9, dtype=int), 4, rng) == []


@pytest.mark.parametrize("folds", [0, 1])
def test_fewer_than_two_folds_hold_nothing_out(rng, folds):
    assert grouped_folds(np.arange(9), folds, rng) == []


def test_the_best_epoch_is_the_first_with_the_lowest_loss():
    assert best_epoch((3.0, 1.0, 2.0, 1.0)) == 2
