"""What a type can derive agrees with listing every parse tree."""

import numpy as np
import pytest

from brute_force import parse_trees
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import terminal_weights
from cutgrammar.inference.reachable import LARGEST, SMALLEST, derivations


@pytest.mark.parametrize("widest", [2, 3])
def test_masses_are_the_summed_priors_of_all_parse_trees(rng, make_grammar, widest):
    for _ in range(5):
        known = derivations(make_grammar(rng, widest=widest), 6)
        for c in range(4):
            for n in range(1, 6):
                priors = [
                    known.probabilities[tree.productions[tree.productions >= 0]].prod()
                    for tree in parse_trees(known, (c,), n)
                ]
                assert known.mass[c, n] == pytest.approx(sum(priors), rel=1e-12)


def test_weights_of_terminals_multiply_the_priors(rng, make_grammar):
    weights = rng.uniform(0.1, 1.0, size=4)
    known = derivations(make_grammar(rng), 6, weights)
    for c in range(4):
        for n in range(1, 6):
            shares = [
                known.probabilities[tree.productions[tree.productions >= 0]].prod()
                * weights[tree.types[tree.terminals]].prod()
                for tree in parse_trees(known, (c,), n)
            ]
            assert known.mass[c, n] == pytest.approx(sum(shares), rel=1e-12)


def test_a_terminal_weighs_how_well_the_goal_s_fragments_fit_it():
    fit = np.log([[0.9, 0.09, 0.01], [0.3, 0.6, 0.1]])
    means = (np.array([1.0, 0.1, 0.01 / 0.9]) + np.array([0.5, 1.0, 0.1 / 0.6])) / 2
    np.testing.assert_allclose(terminal_weights(fit), means / means.max())
    assert terminal_weights(fit - 1e4).min() > 0.0  # each row is known up to a constant only


def test_a_type_without_productions_derives_itself_alone(make_grammar, rng):
    known = derivations(make_grammar(rng), 5)
    np.testing.assert_array_equal(known.mass[3], [0, 1, 0, 0, 0, 0])


def test_production_numbers_go_by_their_order(rng, make_grammar):
    grammar = make_grammar(rng)
    known = derivations(grammar, 3)
    assert list(known.productions) == sorted(grammar.probabilities)
    for c in range(grammar.k):
        assert known.productions[known.options[c] : known.options[c + 1]] == grammar.options.get(c, ())


def test_improbable_derivations_of_many_terminals_stay_possible():
    rare = {Production(0, (0, 1)): 1e-4, Production(0, (1, 1)): 1.0 - 1e-4}
    known = derivations(Grammar(2, rare, (0.5, 0.5)), 200)
    assert (known.mass[0, 1:] >= SMALLEST).all()
    assert known.mass.max() <= LARGEST
    assert (known.mass[1, 2:] == 0).all()


def test_no_terminals_are_refused(rng, make_grammar):
    with pytest.raises(ValueError, match="at least 1 terminal, not 0"):
        derivations(make_grammar(rng), 0)
