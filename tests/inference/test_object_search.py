"""Goal fragments are assigned to current ones, and each current fragment is searched by itself."""

from dataclasses import replace

import numpy as np
import pytest

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.attributes import Attributes
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.object_assignment import assign_objects
from cutgrammar.inference.object_search import search_by_object
from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import best_of, search
from cutgrammar.inference.start import possible_types
from cutgrammar.settings import SearchSettings

GRAMMAR = Grammar(3, {Production(0, (0, 2)): 0.4, Production(0, (1, 2)): 0.3, Production(0, (2, 2)): 0.3,
                      Production(1, (2, 2)): 1.0}, (0.3, 0.3, 0.4))  # fmt: skip
SETTINGS = SearchSettings(max_rounds=60)
CURRENT = np.array([9.0, 5.0, 2.0])
WANTED = np.array([3.0, 1.5, 2.0, 2.2, 2.3, 3.5, 1.5])
"""3 + 2.2 + 2.3 + 1.5 = 9, 3.5 + 1.5 = 5, 2."""


@pytest.fixture
def problem(rng):
    attributes = Attributes(WANTED, CURRENT, np.log([8.0, 4.0, 2.0]), np.full(3, 0.6), conservation=0.02, layout=False)
    shares = np.log(np.array([[0.98, 0.01, 0.01], [0.3, 0.69, 0.01], [0.01, 0.01, 0.98]]))
    shapes = np.log(rng.dirichlet([1.0, 1.0, 8.0], size=7))
    return Problem(GRAMMAR, shares, shapes, rng.normal(size=(7, 3)), 0.1, attributes)


def assigned(problem, rng):
    possible = possible_types(problem, SETTINGS.min_type_probability)
    return assign_objects(problem, derivations(problem.grammar, 8), possible, draws_from(rng))


def test_the_volumes_assigned_to_a_fragment_are_its_own(rng, problem):
    found = assigned(problem, rng)
    np.testing.assert_allclose(np.bincount(found, weights=WANTED), CURRENT, rtol=0.05)


def test_every_current_fragment_gets_one_even_if_volumes_do_not_fit(rng, problem):
    tiny = replace(problem.attributes, current_volumes=np.array([100.0, 1e-3, 1e-3]))
    assert set(assigned(replace(problem, attributes=tiny), rng)) == {0, 1, 2}


def test_fragments_that_lie_together_come_out_of_one(rng, problem):
    places = np.zeros((7, 3))
    places[[1, 3, 6]] = 1.0
    equal = replace(
        problem.attributes, goal_volumes=np.ones(7), current_volumes=np.array([4.0, 3.0]), layout=True, conservation=1.0
    )
    two = replace(problem, log_current=np.log([[0.98, 0.01, 0.01]] * 2), p_WG=places, attributes=equal)
    found = assigned(two, rng)
    assert len(set(found[[1, 3, 6]])) == len(set(found[[0, 2, 4, 5]])) == 1


def test_fragments_go_to_the_object_whose_type_derives_theirs(rng):
    grammar = Grammar(4, {Production(0, (2, 2)): 1.0, Production(1, (3, 3)): 1.0}, (0.25,) * 4)
    fits = np.log(np.array([[0.01, 0.01, 0.9, 0.08], [0.01, 0.01, 0.08, 0.9]] * 2))
    attributes = Attributes(np.ones(4), np.full(2, 2.0), np.zeros(4), np.ones(4), layout=False)
    currents = np.log([[0.97, 0.01, 0.01, 0.01], [0.01, 0.97, 0.01, 0.01]])
    two = Problem(grammar, currents, fits, np.zeros((4, 3)), 0.1, attributes)
    np.testing.assert_array_equal(assigned(two, rng), [0, 1, 0, 1])


def test_a_joined_tree_is_consistent_and_each_fragment_gets_its_volume(problem):
    result = best_of([search_by_object(problem, key, SETTINGS, 10) for key in range(3)])
    assert result.missing == 0
    assert sorted(result.grounding) == list(range(7))
    derived = derivations(problem.grammar, 8)
    for found in result.trees:
        assert len(found.tree.roots) == 3
        assert log_posterior(problem, derived, found.tree, found.grounding).log == pytest.approx(found.log_posterior)
    assert result.history[-1] == pytest.approx(result.posterior.log)
    assert result.posterior.log_volume > -30.0  # no object misses its volume
    logs = [found.log_posterior for found in result.trees]
    assert logs == sorted(logs, reverse=True)


def test_the_search_by_object_finds_better_trees_than_the_joint_one(problem):
    joint = best_of([search(problem, key, SETTINGS) for key in range(3)])
    parts = best_of([search_by_object(problem, key, SETTINGS) for key in range(3)])
    assert parts.posterior.log >= joint.posterior.log


def test_a_search_by_object_repeats_itself(problem):
    first, again = (search_by_object(problem, 7, SETTINGS, 5) for _ in range(2))
    assert first.posterior == again.posterior
    np.testing.assert_array_equal(first.grounding, again.grounding)


def test_an_object_that_no_production_divides_stays_whole(problem):
    heavy = replace(problem.attributes, current_volumes=np.array([9.0, 2.0, 5.0]))  # c2 would have to be cut
    result = search_by_object(replace(problem, attributes=heavy), 0, SETTINGS)
    assert result.posterior.log > -np.inf


def test_one_current_fragment_is_searched_as_a_whole(rng, problem):
    single = replace(
        problem,
        log_current=problem.log_current[:1],
        attributes=replace(problem.attributes, current_volumes=np.array([WANTED.sum()])),
    )
    assert search_by_object(single, 3, SETTINGS).posterior == search(single, 3, SETTINGS).posterior
