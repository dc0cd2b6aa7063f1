"""Types sampled for the current fragments."""

import numpy as np
import pytest

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.start import draw_types, max_terminals, possible_types, target_terminals

HALVES = Grammar(3, {Production(0, (1, 1)): 1.0, Production(1, (2, 2)): 1.0}, (0.2, 0.3, 0.5))


def problem_of(shares, goal):
    return Problem(HALVES, np.log(np.array(shares)), np.zeros((goal, 3)), np.zeros((goal, 3)), 0.1)


def target(shares, goal):
    problem = problem_of(shares, goal)
    derived = derivations(problem.grammar, max_terminals(problem))
    return target_terminals(problem, derived, possible_types(problem, 1e-6))


def test_the_target_is_the_goal_s_number_of_fragments_if_that_can_be_derived():
    assert target([[0.8, 0.1, 0.1]], 3) == 3
    assert target([[0.8, 0.1, 0.1]], 4) == 4


def test_otherwise_the_target_is_the_nearest_number_with_at_least_one_cut():
    assert target([[0.8, 0.1, 0.1]], 7) == 4
    assert target([[1.0 - 2e-7, 1e-7, 1e-7], [1e-7, 1e-7, 1.0 - 2e-7]], 9) == 5


def test_there_is_no_target_if_no_fragment_can_be_cut():
    assert target([[1e-7, 1e-7, 1.0 - 2e-7]], 2) is None


def test_only_types_that_derive_the_target_are_sampled():
    problem = problem_of([[0.5, 0.3, 0.2], [0.1, 0.6, 0.3]], 4)
    derived = derivations(HALVES, max_terminals(problem))
    possible = possible_types(problem, 1e-6)
    rng = np.random.default_rng(0)
    drawn = {pair for _ in range(200) for pair in draw_types(derived, possible, 4, 1, rng)}
    assert drawn == {(0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (2, 0)}  # the other pairs derive at most three
    seven = derivations(HALVES, 9)
    assert {pair for _ in range(50) for pair in draw_types(seven, possible, 7, 1, rng)} == {(0, 0)}


def test_drawing_types_for_an_impossible_number_is_refused():
    problem = problem_of([[0.5, 0.3, 0.2]], 4)
    derived = derivations(HALVES, 9)
    with pytest.raises(ValueError, match="cannot derive 9 terminals"):
        draw_types(derived, possible_types(problem, 1e-6), 9, 1, np.random.default_rng(0))
