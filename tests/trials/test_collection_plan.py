from collections import Counter

import pytest

from cutgrammar.demonstration import CATEGORIES
from cutgrammar.errors import InputError
from cutgrammar.trials.collection_plan import apportion, plan_trials
from cutgrammar.trials.setups import SETUPS


def test_the_papers_110_trials_are_40_and_five_times_14():
    counts = Counter(planned.setup.name for planned in plan_trials(110))
    assert counts == {name: setup.share for name, setup in SETUPS.items()}


@pytest.mark.parametrize("total", [6, 7, 20, 60, 110, 333])
def test_all_trials_are_distributed_and_each_setup_gets_one(total):
    planned = plan_trials(total)
    assert [p.trial for p in planned] == list(range(total))
    assert {p.setup.name for p in planned} == set(SETUPS)
    counts = Counter(p.setup.name for p in planned)
    assert counts["N1M1"] == max(counts.values())


def test_only_requested_setups_are_planned_in_the_standard_order():
    planned = plan_trials(10, ["N3M4", "N1M2", "N3M4"])
    assert [p.setup.name for p in planned] == ["N1M2"] * 5 + ["N3M4"] * 5


def test_sets_of_categories_occur_equally_often():
    for name, setup in SETUPS.items():
        planned = [p for p in plan_trials(110) if p.setup.name == name]
        counts = Counter(p.categories for p in planned)
        assert max(counts.values()) - min(counts.values()) <= 1
        assert all(len(set(c)) == setup.categories and list(c) == sorted(c, key=CATEGORIES.index) for c in counts)


@pytest.mark.parametrize("count", range(1, 15))
def test_the_first_trials_of_a_setup_use_all_categories_about_equally_often(count):
    for name in ("N1M1", "N1M2", "N2M3"):
        named = Counter(dict.fromkeys(CATEGORIES, 0))
        named.update(c for p in plan_trials(count, [name]) for c in p.categories)
        assert max(named.values()) - min(named.values()) <= 1


def test_impossible_plans_are_refused_with_one_line():
    with pytest.raises(InputError, match="5 trials are too few for 6 setups"):
        plan_trials(5)
    with pytest.raises(InputError, match="setup 'N9M9' is unknown; known: N1M1"):
        plan_trials(5, ["N9M9"])
    with pytest.raises(InputError, match="at least one setup is needed"):
        plan_trials(5, [])


def test_apportion_uses_the_largest_remainders():
    assert apportion(16, {"a": 10, "b": 10, "c": 10, "d": 10}) == {"a": 4, "b": 4, "c": 4, "d": 4}
    assert apportion(3, {"a": 1, "b": 1}) == {"a": 2, "b": 1}
    assert apportion(0, {"a": 1, "b": 1}) == {"a": 0, "b": 0}
