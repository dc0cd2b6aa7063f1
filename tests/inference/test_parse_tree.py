"""Every parse tree is built by exactly one sequence of decisions."""

import numpy as np
import pytest

from brute_force import parse_trees
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree, PartialParseTree
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.rollout import choices, roll_out


def as_tuples(tree):
    return tuple(tree.types.tolist()), tuple(tree.productions.tolist())


def test_listing_gives_every_parse_tree_once(rng, make_grammar):
    derived = derivations(make_grammar(rng, max_children=3), 6)
    trees = list(parse_trees(derived, (0, 1), 6))
    assert len({as_tuples(tree) for tree in trees}) == len(trees) > 10
    assert {len(tree.terminals) for tree in trees} == {6}


def test_decisions_in_canonical_order_reach_exactly_the_listed_parse_trees(rng, make_grammar):
    derived = derivations(make_grammar(rng, max_children=3), 8)
    reached = []

    def grow(decisions):
        partial = PartialParseTree.of((0, 1), 5)
        for decision in decisions:
            partial.decide(decision, () if decision == TERMINAL else derived.productions[decision].children)
        if not partial.open:
            reached.append(tuple(partial.productions))
            return
        options, masses = choices(derived, partial)
        assert masses.sum() == pytest.approx(1.0)
        for option in options.tolist():
            grow((*decisions, option))

    grow(())
    listed = [tuple(tree.productions.tolist()) for tree in parse_trees(derived, (0, 1), 5)]
    assert sorted(reached) == sorted(listed)
    assert len(listed) > 10


def test_rollouts_sample_parse_trees_from_the_prior(rng, make_grammar):
    derived = derivations(make_grammar(rng), 5)
    trees = list(parse_trees(derived, (0, 1), 4))
    priors = np.array([derived.probabilities[tree.productions[tree.productions >= 0]].prod() for tree in trees])
    place = {as_tuples(tree): i for i, tree in enumerate(trees)}
    counts = np.zeros(len(trees))
    state = draws_from(rng)
    draws = 5_000
    for _ in range(draws):
        counts[place[as_tuples(roll_out(derived, PartialParseTree.of((0, 1), 4), state))]] += 1
    expected = priors / priors.sum()
    assert np.abs(counts / draws - expected).max() < 5.0 * np.sqrt(0.25 / draws)


def test_rollouts_keep_the_decided_nodes(rng, make_grammar):
    derived = derivations(make_grammar(rng), 8)
    partial = PartialParseTree.of((0,), 6)
    partial.decide(0, derived.productions[0].children)
    tree = roll_out(derived, partial, draws_from(rng))
    assert tree.productions[0] == 0
    assert tree.types[tree.children(0)].tolist() == list(derived.productions[0].children)
    assert len(tree.terminals) == 6
    assert tree.roots.tolist() == [0]


def test_an_infeasible_rollout_is_refused(rng, make_grammar):
    derived = derivations(make_grammar(rng), 8)
    with pytest.raises(ValueError, match=r"leaves of types \[3\] cannot derive 4 terminals"):
        roll_out(derived, PartialParseTree.of((3,), 4), draws_from(rng))


def test_nodes_out_of_order_are_refused():
    with pytest.raises(ValueError, match="parents before children"):
        ParseTree(np.array([0, 1]), np.array([1, START]), np.array([TERMINAL, 0]))
