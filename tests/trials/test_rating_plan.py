"""Which pairs a rater sees: strata, overlap, order and attention checks."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest

from cutgrammar.trials.rating_plan import KINDS, OTHER, RESULT, SAME, number_of_checks, plan_of_rater, stratum_of
from cutgrammar.trials.record import Record, TrialKey

METHODS, SETUPS, GOALS = ("bc", "grammar", "halve"), ("N1M1", "N2M1"), ("in-place", "scattered")


def record(key, fragments):
    return Record(key, "0", None, "done", None, None, {}, fragments, fragments, 1, 0, 0, 0.0, 0.0, ())


@pytest.fixture(scope="module")
def records():
    return [
        record(TrialKey(setup, trial + 20 * s, goals, method, run, "bench", "truth", "o"), 2 + 5 * trial)
        for s, setup in enumerate(SETUPS)
        for trial in range(6)
        for goals in GOALS
        for method in METHODS
        for run in range(2)
    ]


def shown(plan):
    return [pair.key for pair in plan if pair.kind == RESULT]


def test_the_same_request_gives_the_same_plan_in_any_order_of_records(records):
    plan = plan_of_rater(records, "P1", 20, 0)
    assert plan == plan_of_rater(records[::-1], "P1", 20, 0)
    assert plan != plan_of_rater(records, "P2", 20, 0)
    assert plan != plan_of_rater(records, "P1", 20, 1)


@pytest.mark.parametrize("pairs", [7, 12, 24, 30])
def test_pairs_are_spread_evenly_over_methods_setups_and_goal_conditions(records, pairs):
    keys = shown(plan_of_rater(records, "P1", pairs, 0))
    assert len(keys) == len(set(keys)) == pairs
    strata = Counter(map(stratum_of, keys))
    assert max(strata.values()) - min([strata[s] for s in {stratum_of(r.key) for r in records}]) <= 1
    for name, values in (("method", METHODS), ("setup", SETUPS), ("goals", GOALS)):
        counts = Counter(getattr(key, name) for key in keys)
        assert max(counts[v] for v in values) - min(counts[v] for v in values) <= 2


def test_half_of_the_pairs_are_the_same_for_all_raters_and_the_rest_mostly_differ(records):
    plans = [set(shown(plan_of_rater(records, code, 20, 0))) for code in ("P1", "P2", "P3")]
    common = set.intersection(*plans)
    assert 10 <= len(common) <= 13
    assert len(set.union(*plans)) > 25


def test_methods_are_shown_on_the_same_goals(records):
    goals = {}
    for key in shown(plan_of_rater(records, "P1", 24, 0)):
        goals.setdefault((key.setup, key.goals), {}).setdefault(key.method, set()).add(key.trial)
    for by_method in goals.values():
        assert len({frozenset(trials) for trials in by_method.values()}) < 1 + len(METHODS)
        assert set.intersection(*by_method.values())


def test_one_goal_is_not_shown_twice_in_a_row(records):
    for code in ("P1", "P2", "P3", "P4"):
        keys = shown(plan_of_rater(records, code, 30, 0))
        assert all((a.trial, a.goals) != (b.trial, b.goals) for a, b in pairwise(keys))


def test_there_is_one_check_of_each_kind_for_ten_pairs_spread_over_the_session(records):
    for pairs in (4, 10, 30):
        plan = plan_of_rater(records, "P1", pairs, 0)
        kinds = Counter(pair.kind for pair in plan)
        assert kinds[SAME] == kinds[OTHER] == number_of_checks(pairs) == max(1, pairs // 10)
        places = [i for i, pair in enumerate(plan) if pair.kind != RESULT]
        part = len(plan) / len(places)
        assert all(i * part - 1 <= place <= (i + 1) * part + 1 for i, place in enumerate(places))
    first = [pair.kind for pair in plan if pair.kind != RESULT][:2]
    assert set(first) == {SAME, OTHER}


def test_a_check_against_another_goal_is_clearly_different(records):
    fragments = {record.key: record.goal_fragments for record in records}
    for code in "ABCDEFGH":
        for pair in plan_of_rater(records, code, 30, 0):
            assert (pair.other is not None) == (pair.kind == OTHER)
            if pair.other:
                few, many = sorted((fragments[pair.key], fragments[pair.other]))
                assert many >= 2 * few


def test_goals_that_are_all_alike_have_only_checks_against_themselves(records):
    alike = [replace(record, goal_fragments=4) for record in records]
    assert {pair.kind for pair in plan_of_rater(alike, "P1", 20, 0)} == {RESULT, SAME}


def test_a_small_run_has_fewer_pairs(records):
    few = [record for record in records if record.key.trial < 2 and record.key.goals == "in-place"]
    assert len(shown(plan_of_rater(few, "P1", 50, 0))) == 2 * len(METHODS)
    assert plan_of_rater([], "P1", 50, 0) == ()


def test_digests_tell_pairs_apart(records):
    plan = plan_of_rater(records, "P1", 30, 0)
    assert len({pair.digest for pair in plan}) == len(set(plan))
    assert {pair.kind for pair in plan} == set(KINDS)
