"""Enumeration in tables agrees with the brute-force enumeration, and its free optimum is the best of all groundings."""

from itertools import permutations, product

import numpy as np
import pytest

from brute_force import best_by_enumeration, parse_trees
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from measures.enumeration import enumerate_all, parse_trees_by_size, tree_of


def starts_of(problem):
    return list(product(range(problem.grammar.k), repeat=len(problem.log_current)))


@pytest.mark.parametrize(("now", "goal", "max_children"), [(1, 4, 2), (1, 4, 3), (2, 4, 2), (2, 3, 3), (3, 4, 2)])
def test_the_two_step_optimum_equals_that_of_brute_force(rng, make_problem, make_grammar, now, goal, max_children):
    for _ in range(2):
        problem = make_problem(rng, goal=goal, now=now, grammar=make_grammar(rng, max_children=max_children))
        derived = derivations(problem.grammar, goal)
        plain, found = best_by_enumeration(problem, derived, starts_of(problem)), enumerate_all(problem)
        if plain is None:
            assert found is None
            continue
        assert found.two_steps.posterior.log == pytest.approx(plain[0].log, abs=1e-9)
        assert found.trees == sum(1 for types in starts_of(problem) for _ in parse_trees(derived, types, goal))


def test_no_grounding_of_any_parse_tree_is_better_than_the_free_optimum(rng, make_problem):
    for problem in [distant_pairs(), *(make_problem(rng, goal=3, now=2, layout_length_scale=0.01) for _ in range(4))]:
        goal, found = len(problem.log_goal), enumerate_all(problem)
        derived = derivations(problem.grammar, goal)
        best = max(
            log_posterior(problem, derived, tree, np.array(grounding)).log
            for types in starts_of(problem)
            for tree in parse_trees(derived, types, goal)
            for grounding in permutations(range(goal))
        )
        assert found.free.posterior.log == pytest.approx(best, abs=1e-9)
        assert found.free.posterior.log >= found.two_steps.posterior.log


def test_two_steps_miss_the_free_optimum_if_layout_outweighs_shape():
    found = enumerate_all(distant_pairs())
    assert found.two_steps.posterior.log_shape - found.free.posterior.log_shape == pytest.approx(0.2)
    assert found.two_steps.posterior.log_layout == pytest.approx(-40.0)
    assert found.free.posterior.log_layout == pytest.approx(-4.0)


def distant_pairs():
    """Two objects 20 m apart, each cut into fragments of types 1 and 2 that lie 2 m apart; shape favours far pairs."""
    grammar = Grammar(3, {Production(0, (1, 2)): 1.0}, (0.4, 0.3, 0.3))
    log_goal = np.array([[-9.0, -0.9, -1.0], [-9.0, -0.9, -1.0], [-9.0, -1.0, -0.9], [-9.0, -1.0, -0.9]])
    p_WG = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [20.0, 0.0, 0.0], [22.0, 0.0, 0.0]])
    return Problem(grammar, np.log([[0.8, 0.1, 0.1]] * 2), log_goal, p_WG, 1.0)


def test_the_table_lists_every_parse_tree_once(rng, make_grammar):
    derived = derivations(make_grammar(rng, max_children=3), 5)
    table = parse_trees_by_size(derived.productions, 4, 5)
    for (c, n), rows in table.items():
        expected = sorted(tuple(tree.productions) for tree in parse_trees(derived, (c,), n))
        assert sorted(tuple(tree_of(derived.productions, np.array([c]), row).productions) for row in rows) == expected


def test_the_reported_posterior_is_that_of_the_reported_tree_and_grounding(rng, make_problem):
    problem = make_problem(rng, goal=5, now=2)
    derived = derivations(problem.grammar, 5)
    for optimum in (found := enumerate_all(problem)).two_steps, found.free:
        assert log_posterior(problem, derived, optimum.tree, optimum.grounding) == optimum.posterior


def test_a_goal_that_the_grammar_cannot_derive_gives_none():
    problem = Problem(
        Grammar(2, {Production(0, (1, 1)): 1.0}, (0.5, 0.5)), np.zeros((1, 2)), np.zeros((3, 2)), np.eye(3), 1.0
    )
    assert enumerate_all(problem) is None


def test_a_goal_with_too_many_fragments_is_refused(rng, make_problem):
    with pytest.raises(ValueError, match="8 goal fragments are too many to try all groundings; at most 7"):
        enumerate_all(make_problem(rng, goal=8))
