"""Parse trees are grown in one order only."""

import numpy as np
import pytest

from brute_force import parse_trees
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree, PartialParseTree
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.rollout import choices, roll_out


def written(tree):
    return tuple(tree.types.tolist()), tuple(tree.productions.tolist())


def test_listing_gives_every_parse_tree_once(rng, make_grammar):
    known = derivations(make_grammar(rng, widest=3), 6)
    trees = list(parse_trees(known, (0, 1), 6))
    assert len({written(tree) for tree in trees}) == len(trees) > 10
    assert {len(tree.terminals) for tree in trees} == {6}


def test_decisions_in_canonical_order_reach_exactly_the_listed_parse_trees(rng, make_grammar):
    known = derivations(make_grammar(rng, widest=3), 8)
    reached = []

    def grow(decisions):
        growing = PartialParseTree.of((0, 1), 5)
        for decision in decisions:
            growing.decide(decision, () if decision == TERMINAL else known.productions[decision].children)
        if not growing.open:
            reached.append(tuple(growing.productions))
            return
        options, masses = choices(known, growing)
        assert masses.sum() == pytest.approx(1.0)
        for option in options.tolist():
            grow((*decisions, option))

    grow(())
    listed = [tuple(tree.productions.tolist()) for tree in parse_trees(known, (0, 1), 5)]
    assert sorted(reached) == sorted(listed)
    assert len(listed) > 10


def test_rollouts_draw_parse_trees_by_their_prior(rng, make_grammar):
    known = derivations(make_grammar(rng), 5)
    trees = list(parse_trees(known, (0, 1), 4))
    priors = np.array([known.probabilities[tree.productions[tree.productions >= 0]].prod() for tree in trees])
    place = {written(tree): i for i, tree in enumerate(trees)}
    counts = np.zeros(len(trees))
    state = draws_from(rng)
    draws = 5_000
    for _ in range(draws):
        counts[place[written(roll_out(known, PartialParseTree.of((0, 1), 4), state))]] += 1
    expected = priors / priors.sum()
    assert np.abs(counts / draws - expected).max() < 5.0 * np.sqrt(0.25 / draws)


def test_rollouts_keep_what_is_decided(rng, make_grammar):
    known = derivations(make_grammar(rng), 8)
    growing = PartialParseTree.of((0,), 6)
    growing.decide(0, known.productions[0].children)
    tree = roll_out(known, growing, draws_from(rng))
    assert tree.productions[0] == 0
    assert tree.types[tree.children(0)].tolist() == list(known.productions[0].children)
    assert len(tree.terminals) == 6
    assert tree.roots.tolist() == [0]


def test_a_rollout_that_cannot_end_is_refused(rng, make_grammar):
    known = derivations(make_grammar(rng), 8)
    with pytest.raises(ValueError, match=r"leaves of types \[3\] cannot derive 4 terminals"):
        roll_out(known, PartialParseTree.of((3,), 4), draws_from(rng))


def test_nodes_out_of_order_are_refused():
    with pytest.raises(ValueError, match="parents before children"):
        ParseTree(np.array([0, 1]), np.array([1, START]), np.array([TERMINAL, 0]))
