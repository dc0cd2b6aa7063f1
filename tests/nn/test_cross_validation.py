import numpy as np
import pytest

from cutgrammar.nn.cross_validation import fit_and_validate, grouped_folds


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


def test_each_fold_trains_once_then_all_rows_and_what_folds_measure_is_added_up(rng):
    groups, calls = np.repeat(np.arange(6), 3), []
    found = fit_and_validate(
        groups, 3, rng, lambda fit, held: (len(fit), [held.sum(), 1.0]), lambda *c: calls.append(c)
    )
    assert (found.fitted, list(found.networks)) == (18, [12, 12, 12])
    assert found.sums.tolist() == [sum(range(18)), 3.0]
    assert found.losses(18) == (8.5, 3 / 18)
    assert [call[:2] for call in calls] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [len(curve) for _, _, curve in calls] == [2, 2, 2, 0], "nothing is held out of the last training"


def test_where_nothing_can_be_held_out_only_all_rows_are_trained_on(rng):
    found = fit_and_validate(np.zeros(9, dtype=int), 4, rng, lambda fit, held: (len(fit), [0.0]))
    assert (found.fitted, list(found.folds), list(found.networks), found.losses(9)) == (9, [], [], ())
