"""Enumeration in tables agrees with enumeration one by one, and holds the free optimum to its word."""

from itertools import permutations, product

import numpy as np
import pytest

from brute_force import best_exactly, parse_trees
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from measures.enumeration import enumerate_all, parse_trees_by_size, tree_of


def starts_of(problem):
    return list(product(range(problem.grammar.k), repeat=len(problem.log_current)))


@pytest.mark.parametrize(("now", "goal", "widest"), [(1, 4, 2), (1, 4, 3), (2, 4, 2), (2, 3, 3), (3, 4, 2)])
def test_the_best_by_the_two_steps_is_that_of_the_plain_enumeration(rng, make_problem, make_grammar, now, goal, widest):
    for _ in range(2):
        problem = make_problem(rng, goal=goal, now=now, grammar=make_grammar(rng, widest=widest))
        known = derivations(problem.grammar, goal)
        plain, found = best_exactly(problem, known, starts_of(problem)), enumerate_all(problem)
        if plain is None:
            assert found is None
            continue
        assert found.two_steps.posterior.log == pytest.approx(plain[0].log, abs=1e-9)
        assert found.trees == sum(1 for types in starts_of(problem) for _ in parse_trees(known, types, goal))


def test_no_grounding_of_any_parse_tree_is_better_than_the_free_optimum(rng, make_problem):
    for problem in [torn_apart(), *(make_problem(rng, goal=3, now=2, layout_length_scale=0.01) for _ in range(4))]:
        goal, found = len(problem.log_goal), enumerate_all(problem)
        known = derivations(problem.grammar, goal)
        best = max(
            log_posterior(problem, known, tree, np.array(grounding)).log
            for types in starts_of(problem)
            for tree in parse_trees(known, types, goal)
            for grounding in permutations(range(goal))
        )
        assert found.free.posterior.log == pytest.approx(best, abs=1e-9)
        assert found.free.posterior.log >= found.two_steps.posterior.log


def test_where_shape_says_a_little_and_layout_much_the_two_steps_miss_the_free_optimum():
    found = enumerate_all(torn_apart())
    assert found.two_steps.posterior.log_shape - found.free.posterior.log_shape == pytest.approx(0.2)
    assert found.two_steps.posterior.log_layout == pytest.approx(-40.0)
    assert found.free.posterior.log_layout == pytest.approx(-4.0)


def torn_apart():
    """Two objects, each cut into types 1 and 2: pieces lie 2 m apart, objects 20 m; shape pairs far pieces."""
    grammar = Grammar(3, {Production(0, (1, 2)): 1.0}, (0.4, 0.3, 0.3))
    log_goal = np.array([[-9.0, -0.9, -1.0], [-9.0, -0.9, -1.0], [-9.0, -1.0, -0.9], [-9.0, -1.0, -0.9]])
    p_WG = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [20.0, 0.0, 0.0], [22.0, 0.0, 0.0]])
    return Problem(grammar, np.log([[0.8, 0.1, 0.1]] * 2), log_goal, p_WG, 1.0)


def test_every_parse_tree_stands_in_the_table_once(rng, make_grammar):
    known = derivations(make_grammar(rng, widest=3), 5)
    table = parse_trees_by_size(known.productions, 4, 5)
    for (c, n), rows in table.items():
        expected = sorted(tuple(tree.productions) for tree in parse_trees(known, (c,), n))
        assert sorted(tuple(tree_of(known.productions, np.array([c]), row).productions) for row in rows) == expected


def test_the_posterior_told_is_that_of_the_tree_and_grounding_told(rng, make_problem):
    problem = make_problem(rng, goal=5, now=2)
    known = derivations(problem.grammar, 5)
    for one in (found := enumerate_all(problem)).two_steps, found.free:
        assert log_posterior(problem, known, one.tree, one.grounding) == one.posterior


def test_a_goal_that_no_parse_tree_has_is_none():
    problem = Problem(
        Grammar(2, {Production(0, (1, 1)): 1.0}, (0.5, 0.5)), np.zeros((1, 2)), np.zeros((3, 2)), np.eye(3), 1.0
    )
    assert enumerate_all(problem) is None


def test_a_goal_with_too_many_fragments_is_refused(rng, make_problem):
    with pytest.raises(ValueError, match="8 goal fragments are too many to try all groundings; at most 7"):
        enumerate_all(make_problem(rng, goal=8))
