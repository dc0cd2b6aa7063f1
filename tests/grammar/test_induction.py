"""Induction finds the types and productions that made the data."""

import dataclasses
from collections import Counter
from itertools import combinations_with_replacement

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.grammar.clustering import CutArrays, _log_productions, cluster
from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.induction import Smoothed, grammar_of, induce
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.settings import InductionSettings

PLANTED = Grammar(
    5,
    {
        Production(0, (1, 1)): 0.7,
        Production(0, (1, 2)): 0.3,
        Production(1, (3, 3)): 0.5,
        Production(1, (2, 3)): 0.5,
        Production(2, (4, 4)): 1.0,
    },
    (0.2,) * 5,
)
SMALL = InductionSettings(max_k=10, n_starts=3, n_folds=3)


@pytest.fixture
def planted(rng):
    """A corpus of 16 trials that PLANTED made, with its types; the last feature falls with the type."""
    means = np.concatenate([rng.normal(size=(5, 6)), np.linspace(3, -3, 5)[:, None]], axis=1)
    types, trials, cuts = [], [], []
    for trial in range(16):
        leaves = [len(types)]
        types.append(0)
        while leaves:
            node = leaves.pop()
            options = PLANTED.options.get(types[node], ())
            if options:
                shares = [PLANTED.probabilities[option] for option in options]
                made = options[rng.choice(len(options), p=shares)].children
                cuts.append((node, tuple(range(len(types), len(types) + len(made)))))
                leaves.extend(cuts[-1][1])
                types.extend(made)
        trials += [trial] * (len(types) - len(trials))
    types = np.array(types)
    return Corpus(means[types] + 0.15 * rng.normal(size=(len(types), 7)), np.array(trials), tuple(cuts)), types


def test_planted_types_and_productions_are_found_with_k_inside(planted, rng):
    corpus, types = planted
    found = induce(corpus, SMALL, rng)
    assert found.k == 5
    np.testing.assert_array_equal(found.types, types)  # numbered by size, the largest first, as they were planted
    assert set(found.grammar.probabilities) == set(PLANTED.probabilities)
    for production, share in PLANTED.probabilities.items():
        assert found.grammar.probabilities[production] == pytest.approx(share, abs=0.25)
    assert found.gamma == pytest.approx(-0.5 * (7 + 1) * np.log(len(types)))  # that of the BIC


def test_without_the_emission_term_the_best_k_is_1(planted, rng):
    corpus, _ = planted
    settings = InductionSettings(max_k=6, n_starts=2, n_folds=2, emission=False)
    assert induce(corpus, settings, rng).k == 1


def test_induction_repeats_bit_by_bit(planted):
    corpus, _ = planted
    one, two = (induce(corpus, SMALL, np.random.default_rng(4)) for _ in range(2))
    assert (one.curve, one.gammas, one.gamma) == (two.curve, two.gammas, two.gamma)
    np.testing.assert_array_equal(one.types, two.types)
    assert one.grammar == two.grammar


def test_the_curve_has_a_point_for_every_k_and_its_objective_is_the_sum_of_its_terms(planted, rng):
    corpus, _ = planted
    calls = []
    found = induce(corpus, SMALL, rng, lambda done, total: calls.append((done, total)))
    assert [point.k for point in found.curve] == list(range(1, 11))
    assert calls == [(i, 40) for i in range(1, 41)]
    for point in found.curve:
        terms = point.log_productions_mean + point.log_emission_mean + found.gamma * point.k
        assert point.objective_mean == pytest.approx(terms)
        assert point.held_out_mean is not None
    assert found.curve[0].log_productions_mean == 0.0


def test_k_stops_at_the_number_of_different_fragments(rng):
    features = np.repeat(np.eye(3), 2, axis=0)
    corpus = Corpus(features, np.zeros(6, dtype=int), ((0, (2, 3)), (1, (4, 5))))
    found = induce(corpus, SMALL, rng)
    assert [point.k for point in found.curve] == [1, 2, 3]
    assert found.gammas == ()
    assert found.curve[0].held_out_mean is None


def test_frequencies_are_those_of_eq_2():
    corpus = Corpus(np.zeros((7, 1)), np.zeros(7, dtype=int), ((0, (1, 2)), (1, (3, 4)), (2, (5, 6))))
    grammar = grammar_of(corpus, np.array([0, 0, 0, 1, 1, 2, 1]), 3)
    shares = {str(p): share for p, share in grammar.probabilities.items()}
    assert shares == {"c0 -> c0 c0": 1 / 3, "c0 -> c1 c1": 1 / 3, "c0 -> c1 c2": 1 / 3}
    assert grammar.frequencies == (3 / 7, 3 / 7, 1 / 7)


def test_the_compiled_likelihood_of_productions_is_that_of_eq_2(planted, rng):
    corpus, _ = planted
    types = rng.integers(0, 4, len(corpus.trials))
    cuts = CutArrays.of(corpus, 4, rng)
    counts = Counter(corpus.productions(types))
    grammar = grammar_of(corpus, types, 4)
    expected = sum(times * np.log(grammar.probabilities[p]) for p, times in counts.items())
    assert _log_productions(types, 4, cuts.members, cuts.codes) == pytest.approx(expected)


def test_counting_productions_never_makes_the_objective_worse(planted, rng):
    """Moving any one fragment to any other type does not raise the objective that clustering ends at."""
    corpus, _ = planted
    features = corpus.features / corpus.features.std()
    cuts = CutArrays.of(corpus, 6, rng)
    found = cluster(features, cuts, 6, 0.04, rng)

    def objective(types):
        squares = ((features - found.means[types]) ** 2).sum()
        return _log_productions(types, 6, cuts.members, cuts.codes) - squares / (2 * found.variance)

    best = objective(found.types)
    sizes = np.bincount(found.types, minlength=6)
    assert (sizes > 0).all()
    for i in np.flatnonzero(sizes[found.types] > 1)[::5]:
        for c in range(6):
            moved = found.types.copy()
            moved[i] = c
            assert objective(moved) <= best + 1e-6


def test_smoothed_probabilities_of_one_parent_sum_to_1(planted):
    corpus, types = planted
    smoothed = Smoothed.of(corpus.productions(types), types, 5)
    for parent in range(5):
        total = sum(
            np.exp(smoothed.log_probability(Production(parent, children)))
            for n in range(2, 9)
            for children in combinations_with_replacement(range(5), n)
        )
        beyond = 0.5**7 / (smoothed.sizes.total() + 1) / (smoothed.uses[parent] + 1)  # 9 fragments and more
        assert total + beyond == pytest.approx(1.0)


def test_a_cut_into_more_fragments_than_any_before_is_improbable_and_not_impossible(planted):
    corpus, types = planted
    smoothed = Smoothed.of(corpus.productions(types), types, 5)
    chances = [smoothed.log_probability(Production(2, (3,) * n)) for n in range(2, 9)]
    assert np.isfinite(chances).all()
    assert chances == sorted(chances, reverse=True)


def test_a_fixed_number_of_types_is_kept_to(planted):
    corpus, _ = planted
    for k in (1, 3, 8):
        found = induce(corpus, dataclasses.replace(SMALL, fixed_k=k), np.random.default_rng(4))
        assert (found.k, found.grammar.k, len(set(found.types))) == (k, k, k)
    free = induce(corpus, SMALL, np.random.default_rng(4))
    again = induce(corpus, dataclasses.replace(SMALL, fixed_k=free.k), np.random.default_rng(4))
    assert again.grammar == free.grammar
    np.testing.assert_array_equal(again.types, free.types)


def test_more_types_than_were_tried_are_refused(planted, rng):
    with pytest.raises(InputError, match=r"fixed_k = 11 was not tried; 10 types are the most"):
        induce(planted[0], dataclasses.replace(SMALL, fixed_k=11), rng)
