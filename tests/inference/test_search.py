"""The search agrees with brute force, and its result depends on the set of keys alone."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from brute_force import best_by_enumeration
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import best_of, search
from cutgrammar.settings import SearchSettings

SETTINGS = SearchSettings(max_rounds=60)


def same(a, b):
    return (
        a.posterior == b.posterior
        and np.array_equal(a.tree.productions, b.tree.productions)
        and np.array_equal(a.grounding, b.grounding)
        and (a.history, a.rollouts, a.dead_ends, a.missing) == (b.history, b.rollouts, b.dead_ends, b.missing)
    )


def share_of_optimal_results(rng, make_problem, problems, goal, budget):
    reached = 0
    tried = 0
    while tried < problems:
        problem = make_problem(rng, goal=goal, now=1)
        derived = derivations(problem.grammar, goal + 4)
        best = best_by_enumeration(problem, derived, [(c,) for c in range(problem.grammar.k)])
        if best is None:
            continue
        tried += 1
        found = best_of([search(problem, key, budget) for key in range(4)])
        assert found.missing == 0
        assert found.posterior.log <= best[0].log + 1e-9
        reached += found.posterior.log > best[0].log - 1e-9
    return reached / problems


def test_four_searches_of_200_rounds_reach_the_best_of_all_parse_trees_of_four_fragments(rng, make_problem):
    budget = SearchSettings(max_rounds=200, n_starts=16)
    assert share_of_optimal_results(rng, make_problem, 12, 4, budget) >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("goal", "rounds", "problems"), [(5, 1000, 8), (6, 5000, 2)])
def test_longer_searches_reach_the_best_of_all_parse_trees_of_more_fragments(rng, make_problem, goal, rounds, problems):
    budget = SearchSettings(max_rounds=rounds, n_starts=16)
    assert share_of_optimal_results(rng, make_problem, problems, goal, budget) >= 0.95


def test_a_search_is_deterministic_and_keys_give_different_searches(rng, make_problem):
    problem = make_problem(rng, goal=8, now=2)
    assert same(search(problem, 5, SETTINGS), search(pickle.loads(pickle.dumps(problem)), 5, SETTINGS))
    histories = {search(problem, key, SETTINGS).history for key in range(4)}
    assert len(histories) > 1


def test_the_best_of_several_keys_does_not_depend_on_their_grouping(rng, make_problem):
    problem = make_problem(rng, goal=8, now=2)
    found = list(map(partial(search, problem, settings=SETTINGS), range(6)))
    whole = best_of(found)
    assert same(whole, best_of(found[::-1]))
    assert same(whole, best_of([best_of(found[3:]), best_of(found[:3])]))
    assert same(whole, best_of([best_of(found[:1]), best_of(found[1:])]))
    assert whole.rollouts == sum(result.rollouts for result in found)
    assert whole.posterior.log == max(result.posterior.log for result in found)


def test_renumbering_the_goal_renumbers_the_grounding_and_changes_nothing_else(rng, make_problem):
    problem = make_problem(rng, goal=7)
    order = rng.permutation(7)
    renumbered = Problem(
        problem.grammar, problem.log_current, problem.log_goal[order], problem.p_WG[order], problem.layout_length_scale
    )
    one, two = search(problem, 1, SETTINGS), search(renumbered, 1, SETTINGS)
    np.testing.assert_array_equal(one.tree.productions, two.tree.productions)
    np.testing.assert_array_equal(one.grounding, order[two.grounding])
    assert one.posterior.log == pytest.approx(two.posterior.log)


def test_the_history_never_falls_and_ends_at_the_posterior_reported(rng, make_problem):
    problem = make_problem(rng, goal=9, now=3)
    found = search(problem, 0, SETTINGS)
    assert (np.diff(found.history) >= 0).all()
    assert found.history[-1] == pytest.approx(found.posterior.log, abs=1e-9)
    derived = derivations(problem.grammar, 12)
    assert log_posterior(problem, derived, found.tree, found.grounding) == found.posterior


def test_more_rounds_never_give_a_worse_result(rng, make_problem):
    problem = make_problem(rng, goal=10)
    few, many = (search(problem, 3, SearchSettings(max_rounds=rounds)) for rounds in (20, 200))
    assert many.history[: len(few.history)] == few.history
    assert many.posterior.log >= few.posterior.log


def test_a_search_stops_when_the_tree_is_fully_explored():
    grammar = Grammar(2, {Production(0, (1, 1)): 1.0}, (0.5, 0.5))
    problem = Problem(grammar, np.log([[0.9, 0.1]]), np.log(np.full((2, 2), 0.5)), np.eye(2, 3), 1.0)
    assert search(problem, 0, SETTINGS).rollouts == 1


def test_a_goal_that_the_grammar_cannot_derive_is_reported_as_a_dead_end():
    grammar = Grammar(2, {Production(0, (1, 1)): 1.0}, (0.5, 0.5))
    problem = Problem(grammar, np.log([[0.9, 0.1]]), np.log(np.full((5, 2), 0.5)), np.eye(5, 3), 1.0)
    found = search(problem, 0, SETTINGS)
    assert (found.missing, found.dead_ends, len(found.tree.terminals)) == (3, found.rollouts, 2)
    complete = search(Problem(grammar, problem.log_current, problem.log_goal[:2], np.eye(2, 3), 1.0), 0, SETTINGS)
    assert best_of([found, complete]).missing == 0


def test_a_production_with_too_many_children_is_a_dead_end():
    grammar = Grammar(2, {Production(0, (1, 1, 1)): 1.0}, (0.5, 0.5))
    problem = Problem(grammar, np.log([[0.9, 0.1]]), np.log(np.full((2, 2), 0.5)), np.eye(2, 3), 1.0)
    found = search(problem, 0, SETTINGS)
    assert (found.missing, len(found.tree.terminals), sorted(found.grounding)) == (1, 3, [-1, 0, 1])


def test_a_problem_without_a_possible_cut_is_refused(rng):
    grammar = Grammar(2, {Production(0, (1, 1)): 1.0}, (0.5, 0.5))
    problem = Problem(grammar, np.log([[1e-9, 1.0 - 1e-9]]), np.zeros((2, 2)), np.eye(2, 3), 1.0)
    with pytest.raises(ValueError, match="no current fragment can be cut"):
        search(problem, 0, SETTINGS)


def test_best_of_no_results_is_refused():
    with pytest.raises(ValueError, match="no search results"):
        best_of([])


def test_over_a_range_of_scores_the_search_still_finds_the_best_tree(rng, make_problem):
    problem = make_problem(rng, goal=5)
    settings = SearchSettings(max_rounds=400, n_starts=50)
    ranged = replace(settings, score_range=5.0)
    results = [best_of([search(problem, key, chosen) for key in range(2)]) for chosen in (settings, ranged)]
    assert results[1].posterior.log == pytest.approx(results[0].posterior.log)
    assert results[0].history != results[1].history
