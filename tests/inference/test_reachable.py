"""Masses agree with the enumeration of all parse trees."""

import numpy as np
import pytest

from brute_force import parse_trees
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import terminal_weights
from cutgrammar.inference.reachable import MAX_MASS, MIN_MASS, derivations


@pytest.mark.parametrize(("max_children", "min_weight"), [(2, 1.0), (3, 1.0), (2, 0.1)])
def test_masses_sum_the_priors_times_terminal_weights_of_all_parse_trees(rng, make_grammar, max_children, min_weight):
    for _ in range(5):
        weights = rng.uniform(min_weight, 1.0, size=4)
        derived = derivations(make_grammar(rng, max_children=max_children), 6, weights if min_weight < 1.0 else None)
        for c in range(4):
            for n in range(1, 6):
                shares = [
                    derived.probabilities[tree.productions[tree.productions >= 0]].prod()
                    * weights[tree.types[tree.terminals]].prod()
                    for tree in parse_trees(derived, (c,), n)
                ]
                assert derived.mass[c, n] == pytest.approx(sum(shares), rel=1e-12)


def test_terminal_weights_measure_how_well_the_goal_fits_a_type():
    fit = np.log([[0.9, 0.09, 0.01], [0.3, 0.6, 0.1]])
    means = (np.array([1.0, 0.1, 0.01 / 0.9]) + np.array([0.5, 1.0, 0.1 / 0.6])) / 2
    np.testing.assert_allclose(terminal_weights(fit), means / means.max())
    assert terminal_weights(fit - 1e4).min() > 0.0  # each row is defined up to a constant


def test_a_type_without_productions_derives_only_itself(make_grammar, rng):
    derived = derivations(make_grammar(rng), 5)
    np.testing.assert_array_equal(derived.mass[3], [0, 1, 0, 0, 0, 0])


def test_productions_are_numbered_in_sorted_order(rng, make_grammar):
    grammar = make_grammar(rng)
    derived = derivations(grammar, 3)
    assert list(derived.productions) == sorted(grammar.probabilities)
    for c in range(grammar.k):
        assert derived.productions[derived.options[c] : derived.options[c + 1]] == grammar.options.get(c, ())


def test_improbable_derivations_of_many_terminals_stay_possible():
    rare = {Production(0, (0, 1)): 1e-4, Production(0, (1, 1)): 1.0 - 1e-4}
    derived = derivations(Grammar(2, rare, (0.5, 0.5)), 200)
    assert (derived.mass[0, 1:] >= MIN_MASS).all()
    assert derived.mass.max() <= MAX_MASS
    assert (derived.mass[1, 2:] == 0).all()


def test_no_terminals_are_refused(rng, make_grammar):
    with pytest.raises(ValueError, match="at least 1 terminal, not 0"):
        derivations(make_grammar(rng), 0)
