"""Grounding: assignment followed by annealing."""

from itertools import permutations

import numpy as np
import pytest

from brute_force import groundings, parse_trees
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.grounding import anneal, assign
from cutgrammar.inference.posterior import UNGROUNDED, log_layout, log_shape
from cutgrammar.inference.reachable import derivations


def trees_of(problem, goal):
    derived = derivations(problem.grammar, goal)
    trees = [tree for c in range(3) for tree in parse_trees(derived, (c,), goal)]
    return [tree for tree in trees[:: max(len(trees) // 8, 1)] if len(set(tree.types[tree.terminals])) < goal]


def test_annealing_finds_the_best_grounding_that_the_two_steps_allow(rng, make_problem):
    found, best = [], []
    for _ in range(3):
        problem = make_problem(rng, goal=5)
        for tree in trees_of(problem, 5):
            first = assign(tree.types[tree.terminals], problem.log_goal)
            _, layout = anneal(tree, first, problem.p_WG, problem.layout_length_scale, 20 * 5, draws_from(rng))
            found.append(layout)
            best.append(
                max(log_layout(tree, g, problem.p_WG, problem.layout_length_scale) for g in groundings(problem, tree))
            )
    found, best = np.array(found), np.array(best)
    assert len(found) > 20
    assert (found <= best + 1e-9).all()
    assert (found > best - 1e-9).mean() > 0.9


def test_annealing_swaps_only_within_a_type_and_returns_the_layout_term_of_its_grounding(rng, make_problem):
    problem = make_problem(rng, goal=6, now=1)
    for tree in trees_of(problem, 6):
        first = assign(tree.types[tree.terminals], problem.log_goal)
        grounding, layout = anneal(tree, first, problem.p_WG, problem.layout_length_scale, 100, draws_from(rng))
        assert sorted(grounding) == list(range(6))
        assert log_shape(tree, grounding, problem.log_goal) == pytest.approx(log_shape(tree, first, problem.log_goal))
        assert layout == pytest.approx(
            log_layout(tree, grounding, problem.p_WG, problem.layout_length_scale), abs=1e-12
        )
        assert layout >= log_layout(tree, first, problem.p_WG, problem.layout_length_scale) - 1e-9


def test_without_swaps_the_grounding_is_the_assignment(rng, make_problem):
    problem = make_problem(rng, goal=5)
    tree = next(tree for tree in trees_of(problem, 5) if len(set(tree.types[tree.terminals])) < 5)
    first = assign(tree.types[tree.terminals], problem.log_goal)
    grounding, layout = anneal(tree, first, problem.p_WG, problem.layout_length_scale, 0, draws_from(rng))
    np.testing.assert_array_equal(grounding, first)
    assert layout == pytest.approx(log_layout(tree, first, problem.p_WG, problem.layout_length_scale))


def test_annealing_is_deterministic(rng, make_problem):
    problem = make_problem(rng, goal=6)
    tree = trees_of(problem, 6)[0]
    first = assign(tree.types[tree.terminals], problem.log_goal)
    runs = [
        anneal(tree, first, problem.p_WG, problem.layout_length_scale, 200, draws_from(np.random.default_rng(1)))
        for _ in range(2)
    ]
    assert runs[0][1] == runs[1][1]
    np.testing.assert_array_equal(runs[0][0], runs[1][0])


def test_the_assignment_is_optimal(rng, make_problem):
    problem = make_problem(rng, goal=5)
    types = np.array([2, 0, 0, 1, 2])
    value = problem.log_goal[assign(types, problem.log_goal), types].sum()
    assert value == pytest.approx(max(problem.log_goal[list(p), types].sum() for p in permutations(range(5))))


def test_more_terminals_than_fragments_leave_some_ungrounded(rng, make_problem):
    problem = make_problem(rng, goal=5)
    types = np.array([2, 0, 0, 1, 2, 0, 1])
    grounding = assign(types, problem.log_goal)
    assert sorted(grounding) == [UNGROUNDED, UNGROUNDED, 0, 1, 2, 3, 4]
    tree = trees_of(problem, 5)[0]
    part = assign(tree.types[tree.terminals], problem.log_goal[:3])
    best, layout = anneal(tree, part, problem.p_WG[:3], problem.layout_length_scale, 100, draws_from(rng))
    assert layout == pytest.approx(log_layout(tree, best, problem.p_WG[:3], problem.layout_length_scale), abs=1e-12)
