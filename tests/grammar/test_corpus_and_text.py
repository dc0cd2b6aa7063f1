"""The corpus of an induction, and grammars as text."""

import numpy as np
import pytest

from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.text import describe


def test_a_sub_corpus_renumbers_its_fragments():
    features = np.arange(12.0).reshape(6, 2)
    corpus = Corpus(features, np.array([4, 4, 4, 7, 7, 7]), ((0, (1, 2)), (5, (3, 4))))
    part = corpus.of_trials(np.array([7]))
    np.testing.assert_array_equal(part.features, features[3:])
    assert part.cuts == ((2, (0, 1)),)
    assert corpus.productions(np.array([0, 1, 1, 2, 1, 0])) == [Production(0, (1, 1)), Production(0, (1, 2))]


@pytest.mark.parametrize(
    ("cuts", "text"),
    [
        ((), "at least one cut"),
        (((0, (1,)),), "two or more"),
        (((0, (1, 9)),), "two or more"),
        (((0, (1, 3)),), "same trial"),
        (((0, (1, 2)), (0, (1, 2))), "cut twice"),
        (((0, (1, 2)), (1, (2, 0))), "produced twice"),
    ],
)
def test_an_inconsistent_corpus_is_refused(cuts, text):
    with pytest.raises(ValueError, match=text):
        Corpus(np.zeros((4, 2)), np.array([0, 0, 0, 1]), cuts)


def test_a_grammar_is_described_in_readable_text():
    probabilities = {Production(0, (0, 1)): 0.75, Production(0, (1, 1)): 0.25}
    assert describe(Grammar(2, probabilities, (0.4, 0.6))).splitlines() == [
        "2 fragment types, 2 productions; v_S produces the current fragments",
        "c0  (40 %)  -> c0 c1  .75",
        "             | c1 c1  .25",
        "c1  (60 %)  never cut",
    ]


def test_a_production_of_probability_one_is_described_as_1_00():
    assert describe(Grammar(1, {Production(0, (0, 0)): 1.0}, (1.0,))).splitlines()[1] == "c0 (100 %)  -> c0 c0  1.00"
