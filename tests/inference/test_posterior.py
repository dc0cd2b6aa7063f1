"""The laws of Eq. (3) to (7)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from brute_force import parse_trees
from cutgrammar.inference.draws import below, draws_from, uniform
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree
from cutgrammar.inference.posterior import UNGROUNDED, log_grouping, log_layout, log_posterior, log_shape
from cutgrammar.inference.problem import Problem, shape_likelihood
from cutgrammar.inference.reachable import derivations


@pytest.fixture
def case(rng, make_problem):
    """A problem, the derivations of its grammar, a parse tree and a grounding."""
    problem = make_problem(rng, goal=5, now=2)
    derived = derivations(problem.grammar, 6)
    trees = [tree for types in ((0, 1), (1, 2), (0, 2)) for tree in parse_trees(derived, types, 5)]
    return problem, derived, trees[len(trees) // 2], rng.permutation(5)


def with_goal(problem, order=slice(None), places=None):
    places = problem.p_WG if places is None else places
    return Problem(
        problem.grammar, problem.log_current, problem.log_goal[order], places[order], problem.layout_length_scale
    )


def test_renumbering_the_goal_does_not_change_the_posterior(case, rng):
    problem, derived, tree, grounding = case
    order = rng.permutation(5)
    renumbered = log_posterior(with_goal(problem, order), derived, tree, np.argsort(order)[grounding])
    assert renumbered.log == pytest.approx(log_posterior(problem, derived, tree, grounding).log, abs=1e-12)


def test_a_rigid_motion_of_the_goal_does_not_change_the_posterior(case, rng):
    problem, derived, tree, grounding = case
    moved = Rotation.random(rng=rng).apply(problem.p_WG.copy()) + rng.normal(size=3)
    expected = log_posterior(problem, derived, tree, grounding).log_layout
    assert log_posterior(with_goal(problem, places=moved), derived, tree, grounding).log_layout == pytest.approx(
        expected
    )


def test_the_posterior_of_a_small_parse_tree_equals_that_computed_by_hand(make_grammar, rng):
    grammar = make_grammar(rng)
    derived = derivations(grammar, 3)
    first = derived.productions[0]
    a, b = first.children
    tree = ParseTree(np.array([first.parent, a, b]), np.array([START, 0, 0]), np.array([0, TERMINAL, TERMINAL]))
    log_current, log_goal = np.log(rng.dirichlet(np.ones(4), 1)), np.log(rng.dirichlet(np.ones(4), 2))
    problem = Problem(
        grammar, log_current, log_goal, np.array([[0.0, 0, 0], [0.06, 0, 0.08]]), layout_length_scale=0.02
    )
    found = log_posterior(problem, derived, tree, np.array([1, 0]))
    assert found.log_prior == pytest.approx(np.log(grammar.probabilities[first]) + log_current[0, first.parent])
    assert found.log_shape == pytest.approx(log_goal[1, a] + log_goal[0, b])
    assert found.log_layout == pytest.approx(-2 * 0.05 / 0.02)  # 0.1 m apart, so each 0.05 m from the middle
    assert found.log == found.log_prior + found.log_shape + found.log_layout


def test_current_fragments_may_lie_anywhere(make_grammar, rng):
    """v_S produces them, which is not a cut: the layout term covers only the fragments of each production."""
    tree = ParseTree(np.array([3, 3]), np.array([START, START]), np.array([TERMINAL, TERMINAL]))
    assert log_layout(tree, np.array([0, 1]), rng.normal(size=(2, 3)), 0.1) == 0.0


def test_terminals_without_a_fragment_contribute_nothing():
    tree = ParseTree(np.array([0, 1, 1, 1]), np.array([START, 0, 0, 0]), np.array([0, *[TERMINAL] * 3]))
    places = np.array([[0.0, 0, 0], [0.2, 0, 0]])
    log_goal = np.log(np.full((2, 2), 0.5))
    grounding = np.array([0, UNGROUNDED, 1])
    assert log_layout(tree, grounding, places, 0.1) == pytest.approx(-2.0)
    assert log_shape(tree, grounding, log_goal) == pytest.approx(2 * np.log(0.5))


def test_grouping_falls_by_one_nat_per_length_scale():
    centre = np.zeros(3)
    assert log_grouping(np.array([[0.3, 0, 0]]), centre, 0.1) == pytest.approx(-3.0)


@pytest.mark.parametrize(("centres", "text"), [(np.zeros((0, 3)), r"\(m, 3\)"), (np.full((1, 3), np.nan), "finite")])
def test_invalid_centres_are_refused(centres, text):
    with pytest.raises(ValueError, match=text):
        log_grouping(centres, np.zeros(3), 0.1)


def test_a_grounding_that_uses_a_fragment_twice_is_refused(case):
    problem, derived, tree, _ = case
    with pytest.raises(ValueError, match="distinct fragments"):
        log_posterior(problem, derived, tree, np.zeros(5, dtype=int))


def test_eq_5_divides_by_the_type_prior_on_request(make_grammar, rng):
    grammar = make_grammar(rng)
    log_types = np.log(rng.dirichlet(np.ones(4), 3))
    np.testing.assert_array_equal(shape_likelihood(log_types, grammar, False), log_types)
    by_bayes = shape_likelihood(log_types, grammar, True)
    np.testing.assert_allclose(np.exp(by_bayes) * grammar.frequencies, np.exp(log_types))


def test_inconsistent_problems_are_refused(make_problem, rng):
    problem = make_problem(rng)
    with pytest.raises(ValueError, match=r"p_WG has shape \(5, 3\); \(4, 3\) was expected"):
        Problem(problem.grammar, problem.log_current, problem.log_goal[:4], problem.p_WG, 0.1)
    with pytest.raises(ValueError, match="layout_length_scale is 0"):
        Problem(problem.grammar, problem.log_current, problem.log_goal, problem.p_WG, 0.0)


def test_compiled_streams_are_deterministic_and_uniform(rng):
    one, two = draws_from(np.random.default_rng(3)), draws_from(np.random.default_rng(3))
    drawn = np.array([uniform(one) for _ in range(5000)])
    assert drawn.tolist() == [uniform(two) for _ in range(5000)]
    assert 0.0 <= drawn.min() < drawn.max() < 1.0
    assert abs(drawn.mean() - 0.5) < 5 / np.sqrt(12 * 5000)
    assert {below(one, 3) for _ in range(100)} == {0, 1, 2}
