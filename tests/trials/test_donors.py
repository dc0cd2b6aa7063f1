"""Who can be the donor of whom; see `test_goals` for what becomes of the donors."""

import pytest

from cutgrammar.errors import InputError
from cutgrammar.trials.donors import DonorPool


@pytest.fixture
def pool(demonstrate):
    """Makes a pool of one-object trials, given trial -> (food, category)."""

    def make(test, spare=None, seed=0):
        known = {**test, **(spare or {})}

        def read(trial):
            food, category = known[trial]
            return demonstrate(trial, categories=(category,), foods=(food,), cuts=1)

        return DonorPool(read, test, spare or {}, seed)

    return make


MIXED = {
    0: ("potato", "slices"),
    1: ("potato", "cubes"),
    2: ("carrot", "slices"),
    3: ("potato", "slices"),
    4: ("carrot", "slices"),
    5: ("potato", "slices"),
}


def drawn(pool, condition, trial=0, seeds=range(40)):
    return {pool(seed).choose("N1M1", trial, condition)[0].trial for seed in seeds}


def test_a_donor_has_the_same_categories_and_the_same_food_where_one_has(pool):
    assert drawn(lambda seed: pool(MIXED, seed=seed), "foreign") == {3, 5}


def test_a_donor_of_another_food_takes_its_place_where_none_has(pool):
    few = {trial: facts for trial, facts in MIXED.items() if trial not in (3, 5)}
    assert drawn(lambda seed: pool(few, seed=seed), "foreign") == {2, 4}


def test_foreign_food_takes_another_food_only(pool):
    assert drawn(lambda seed: pool(MIXED, seed=seed), "foreign-food") == {2, 4}


def test_a_trial_is_never_its_own_donor_and_training_trials_are_not_in_the_pool(pool):
    alone = {0: MIXED[0], 1: MIXED[1]}
    message = "trial 0 has no foreign goal: no other trial outside the training set has an object cut into slices"
    with pytest.raises(InputError, match=message):
        pool(alone).choose("N1M1", 0, "foreign")
    with pytest.raises(
        InputError, match="has an object of another food cut into slices, as its potato is; collect more"
    ):
        pool({**alone, 3: MIXED[3]}).choose("N1M1", 0, "foreign-food")


def test_trials_outside_the_split_are_donors_only_where_no_test_trial_is(pool):
    spare = {7: ("potato", "slices"), 8: ("carrot", "slices")}
    test = {0: MIXED[0], 3: MIXED[3]}
    assert drawn(lambda seed: pool(test, spare, seed), "foreign") == {3}
    assert drawn(lambda seed: pool(test, spare, seed), "foreign-food") == {8}


def test_two_objects_have_different_donors_where_there_are_enough(demonstrate):
    def read(trial):
        return demonstrate(trial, "N2M1", foods=("potato", "potato"), cuts=2)

    for seed in range(20):
        first, second = DonorPool(read, (0, 1), (), seed).choose("N2M1", 0, "foreign")
        assert {(first.trial, first.number), (second.trial, second.number)} == {(1, 0), (1, 1)}


def test_the_donors_depend_on_seed_trial_and_condition_alone(pool):
    many = dict.fromkeys(range(30), ("potato", "slices"))
    first, second = pool(many), pool(many)
    order = list(range(30))
    chosen = {trial: first.choose("N1M1", trial, "foreign") for trial in order}
    assert chosen == {trial: second.choose("N1M1", trial, "foreign") for trial in reversed(order)}
    assert len({facts[0].trial for facts in chosen.values()}) > 10
    assert chosen != {trial: pool(many, seed=1).choose("N1M1", trial, "foreign") for trial in order}
    (donor,) = second.objects("N1M1", 0, "foreign")
    assert (donor.trial, donor.food) == (chosen[0][0].trial, "potato")


def test_objects_whose_fragments_have_no_category_count_with_those_of_the_trial(demonstrate):
    import dataclasses

    def read(trial):
        whole = demonstrate(trial, categories=("strips",), cuts=1)
        fragments = tuple(dataclasses.replace(fragment, category=None) for fragment in whole.fragments)
        return dataclasses.replace(whole, fragments=fragments)

    (donor,) = DonorPool(read, (0, 1), (), 0).choose("N1M1", 0, "foreign")
    assert (donor.trial, donor.categories) == (1, frozenset({"strips"}))
