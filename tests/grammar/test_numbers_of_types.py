from itertools import pairwise

import pytest

from cutgrammar.grammar.numbers_of_types import between_neighbours, growing_grid, has_turned


@pytest.mark.parametrize("limit", [1, 2, 15, 16, 17, 300, 17_000])
def test_the_grid_ascends_to_its_limit_in_steps_of_at_most_an_eighth(limit):
    ks = list(growing_grid(limit))
    assert ks[-1] == limit
    assert all(a < b <= a + max(1, a // 8) for a, b in pairwise(ks))
    assert len(ks) < 100


def test_the_objective_has_turned_only_well_beyond_its_best():
    assert not has_turned({1: 0.0, 10: 5.0, 16: 4.0})
    assert has_turned({1: 0.0, 10: 5.0, 17: 4.0})
    assert not has_turned({1: 0.0, 10: 5.0, 17: 6.0})


def test_of_equal_objectives_the_smallest_number_of_types_counts():
    assert has_turned({1: 0.0, 2: 0.0, 6: 0.0})


def test_a_finer_grid_lies_between_the_neighbours_of_the_best():
    assert between_neighbours({10: 1.0, 12: 3.0, 15: 2.0, 20: 0.0}) == [11, 13, 14]
    assert between_neighbours({1: 3.0, 2: 1.0}) == []
    fine = between_neighbours({100: 1.0, 112: 3.0, 126: 2.0})
    assert len(fine) <= 8
    assert fine[0] == 101
    assert 112 not in fine
