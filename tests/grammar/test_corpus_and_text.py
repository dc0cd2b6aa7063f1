"""What a grammar is induced from, and how it is written down."""

import numpy as np
import pytest

from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.text import describe


def test_a_part_of_a_corpus_numbers_its_fragments_anew():
    features = np.arange(12.0).reshape(6, 2)
    corpus = Corpus(features, np.array([4, 4, 4, 7, 7, 7]), ((0, (1, 2)), (5, (3, 4))))
    part = corpus.of_trials(np.array([7]))
    np.testing.assert_array_equal(part.features, features[3:])
    assert part.cuts == ((2, (0, 1)),)
    assert corpus.productions(np.array([0, 1, 1, 2, 1, 0])) == [Production(0, (1, 1)), Production(0, (1, 2))]


@pytest.mark.parametrize(
    ("cuts", "text"),
    [
        ((), "without cuts"),
        (((0, (1,)),), "two or more"),
        (((0, (1, 9)),), "two or more"),
        (((0, (1, 3)),), "in one trial"),
        (((0, (1, 2)), (0, (1, 2))), "cut twice"),
        (((0, (1, 2)), (1, (2, 0))), "made twice"),
    ],
)
def test_a_corpus_that_cannot_be_is_refused(cuts, text):
    with pytest.raises(ValueError, match=text):
        Corpus(np.zeros((4, 2)), np.array([0, 0, 0, 1]), cuts)


def test_a_grammar_is_written_as_a_person_would():
    probabilities = {Production(0, (0, 1)): 0.75, Production(0, (1, 1)): 0.25}
    assert describe(Grammar(2, probabilities, (0.4, 0.6))).splitlines() == [
        "2 fragment types, 2 productions; v_S produces the current fragments",
        "c0  (40 %)  -> c0 c1  .75",
        "             | c1 c1  .25",
        "c1  (60 %)  never cut",
    ]


def test_a_certain_production_is_written_as_such():
    assert describe(Grammar(1, {Production(0, (0, 0)): 1.0}, (1.0,))).splitlines()[1] == "c0 (100 %)  -> c0 c0  1.00"
