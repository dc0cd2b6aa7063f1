"""The terms that grammar-plus adds to the posterior, and the annealing that takes them into account."""

import pickle
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from brute_force import parse_trees
from cutgrammar.inference.attributed_grounding import anneal_attributes, anneal_in_place
from cutgrammar.inference.attributes import (
    BACKGROUND,
    BACKGROUND_RANGE,
    Attributes,
    log_stays,
    log_volume,
    node_volumes,
)
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.posterior import UNGROUNDED, log_posterior
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import best_of, search
from cutgrammar.settings import SearchSettings

TREE = ParseTree(np.array([0, 1, 2, 2, 2, 3]), np.array([-1, 0, 1, 1, 0, -1]), np.array([0, 1, -1, -1, -1, -1]))
"""c0 -> (c1 -> c2 c2) c2, beside a second current fragment c3 that stays whole."""


def attributes(rng, goal, now, k=4, **changes):
    values = {
        "goal_volumes": rng.uniform(1.0, 5.0, size=goal),
        "current_volumes": rng.uniform(5.0, 20.0, size=now),
        "log_volume": rng.uniform(0.0, 2.0, size=k),
        "log_volume_std": rng.uniform(0.1, 0.5, size=k),
        "log_whole": np.log(rng.uniform(0.1, 0.9, size=k)),
    }
    return Attributes(**(values | changes))


@pytest.fixture
def problem(rng, make_problem):
    plain = make_problem(rng, goal=5, now=1)
    return replace(plain, attributes=attributes(rng, 5, 1))


def trees_of(problem, goal):
    derived = derivations(problem.grammar, goal)
    trees = [tree for c in range(3) for tree in parse_trees(derived, (c,), goal)]
    return derived, trees[:: max(len(trees) // 8, 1)]


def test_the_volume_of_a_node_is_that_of_the_goal_s_fragments_below_it():
    volumes = node_volumes(TREE, np.array([3, 0, 1, 2]), np.array([1.0, 2.0, 4.0, 8.0]))
    np.testing.assert_array_equal(volumes, [11.0, 9.0, 8.0, 1.0, 2.0, 4.0])
    volumes = node_volumes(TREE, np.array([3, UNGROUNDED, 1, UNGROUNDED]), np.array([1.0, 2.0, 4.0, 8.0]))
    np.testing.assert_array_equal(volumes, [10.0, 8.0, 8.0, 0.0, 2.0, 0.0])


def test_the_volume_term_sums_over_all_nodes_and_ties_roots_to_their_fragments(rng):
    given = attributes(rng, 4, 2, volume_weight=0.5, conservation=0.2)
    grounding = np.array([3, 0, 1, 2])
    volumes = node_volumes(TREE, grounding, given.goal_volumes)
    expected = 0.0
    for c, volume in zip(TREE.types, volumes, strict=True):
        s = given.log_volume_std[c]
        normal = np.exp(-0.5 * ((np.log(volume) - given.log_volume[c]) / s) ** 2) / (s * np.sqrt(2 * np.pi))
        expected += 0.5 * np.log((1 - BACKGROUND) * normal + BACKGROUND / BACKGROUND_RANGE)
    for fragment, root in enumerate(TREE.roots):
        expected -= 0.5 * ((np.log(volumes[root] / given.current_volumes[fragment])) / 0.2) ** 2
    assert log_volume(TREE, grounding, given) == pytest.approx(expected)
    assert log_volume(TREE, grounding, replace(given, volume_weight=0.0, conservation=0.0)) == 0.0


def test_a_node_without_grounded_terminals_has_no_volume_term(rng):
    given = attributes(rng, 4, 2)
    part = log_volume(TREE, np.array([3, 0, 1, UNGROUNDED]), given)
    only_root = ParseTree(np.array([3]), np.array([-1]), np.array([-1]))
    second = replace(given, current_volumes=given.current_volumes[1:])
    assert part + log_volume(only_root, np.array([2]), second) == pytest.approx(
        log_volume(TREE, np.array([3, 0, 1, 2]), given)
    )


def test_every_node_chooses_between_staying_whole_and_being_cut(rng):
    given = attributes(rng, 4, 2)
    whole = np.exp(given.log_whole)
    expected = (1 - whole[0]) * (1 - whole[1]) * whole[2] ** 3 * whole[3]
    assert log_stays(TREE, given) == pytest.approx(np.log(expected))
    assert log_stays(TREE, replace(given, log_whole=None)) == 0.0


def test_masses_take_the_probability_to_stay_whole_into_account(rng, make_grammar):
    grammar, weights = make_grammar(rng), rng.uniform(0.1, 1.0, size=4)
    given = attributes(rng, 4, 1)
    derived = derivations(grammar, 5, weights, np.exp(given.log_whole))
    for c in range(4):
        for n in range(1, 6):
            total = sum(
                np.exp(derived.log_probabilities[tree.productions[tree.productions >= 0]].sum())
                * weights[tree.types[tree.terminals]].prod()
                * np.exp(log_stays(tree, given))
                for tree in parse_trees(derived, (c,), n)
            )
            assert derived.mass[c, n] == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("layout", [True, False])
@pytest.mark.parametrize("swap_types", [True, False])
def test_the_incremental_annealing_gains_what_recomputation_finds(rng, problem, layout, swap_types):
    problem = replace(problem, attributes=replace(problem.attributes, layout=layout, swap_types=swap_types))
    derived, trees = trees_of(problem, 5)
    gains = []
    for tree in trees:
        grounding = rng.permutation(5)
        before = log_posterior(problem, derived, tree, grounding).log
        best = grounding.copy()
        goal = problem.p_WG, problem.attributes.goal_volumes, problem.log_goal
        weight = 1.0 / problem.layout_length_scale if layout else 0.0
        state = draws_from(rng)
        gain, total = anneal_in_place(
            tree.types, tree.parents, tree.terminals, best, goal, weight, problem.attributes.compiled, swap_types, 200,
            state,
        )  # fmt: skip
        after = log_posterior(problem, derived, tree, best)
        assert after.log - before == pytest.approx(gain, abs=1e-8)
        assert total == pytest.approx(after.log_shape + after.log_layout + after.log_volume)
        if not swap_types:
            for c in np.unique(tree.types[tree.terminals]):
                chosen = tree.types[tree.terminals] == c
                assert sorted(best[chosen]) == sorted(grounding[chosen])
        gains.append(gain)
    assert max(gains) > 1.0


def test_annealing_across_types_finds_the_best_of_all_groundings(rng, problem):
    derived, trees = trees_of(problem, 5)
    found, best = [], []
    for tree in trees:
        grounding, rest = anneal_attributes(tree, np.arange(5), problem, 400, draws_from(rng))
        posterior = log_posterior(problem, derived, tree, grounding)
        assert rest == pytest.approx(posterior.log_shape + posterior.log_layout + posterior.log_volume)
        found.append(posterior.log)
        best.append(max(log_posterior(problem, derived, tree, np.array(p)).log for p in permutations(range(5))))
    assert (np.array(found) > np.array(best) - 1e-6).mean() > 0.8


def test_the_search_finds_the_best_tree_with_all_terms(rng, make_problem):
    problem = replace(make_problem(rng, goal=4, now=1), attributes=attributes(rng, 4, 1))
    derived = derivations(problem.grammar, 4)
    trees = [tree for c in range(4) for tree in parse_trees(derived, (c,), 4)]
    best = max(log_posterior(problem, derived, tree, np.array(p)).log for tree in trees for p in permutations(range(4)))
    settings = SearchSettings(max_rounds=2000, n_starts=50, swaps_per_terminal=60)
    result = best_of([search(problem, key, settings) for key in range(2)])
    assert result.posterior.log == pytest.approx(best, abs=1e-6)
    assert result.posterior.log_volume is not None


def test_without_layout_places_change_nothing(rng, problem):
    problem = replace(problem, attributes=replace(problem.attributes, layout=False))
    derived, trees = trees_of(problem, 5)
    moved = replace(problem, p_WG=rng.normal(size=(5, 3)))
    assert all(
        log_posterior(problem, derived, tree, np.arange(5)) == log_posterior(moved, derived, tree, np.arange(5))
        for tree in trees
    )


def test_attributes_travel_to_workers(problem):
    copy = pickle.loads(pickle.dumps(problem))
    assert search(problem, 3, SearchSettings()).posterior == search(copy, 3, SearchSettings()).posterior


def test_attributes_must_fit_the_problem(rng, problem):
    with pytest.raises(ValueError, match="attributes are not those"):
        replace(problem, attributes=attributes(rng, 4, 1))
    with pytest.raises(ValueError, match="must be positive"):
        attributes(rng, 4, 1, goal_volumes=np.array([1.0, 0.0, 1.0, 1.0]))
