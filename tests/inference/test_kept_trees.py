"""The distinct parse trees that a search keeps beside the best."""

import numpy as np
import pytest

from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import best_of, search
from cutgrammar.settings import SearchSettings

SETTINGS = SearchSettings(max_rounds=100)


def test_kept_trees_are_distinct_ranked_and_led_by_the_best(rng, make_problem):
    problem = make_problem(rng, goal=5, now=2)
    result = best_of([search(problem, key, SETTINGS, n_trees=12) for key in range(3)])
    assert len(result.trees) == 12
    logs = [found.log_posterior for found in result.trees]
    assert logs == sorted(logs, reverse=True)
    assert len({(*found.tree.types, *found.tree.productions) for found in result.trees}) == 12
    assert result.trees[0].log_posterior == pytest.approx(result.posterior.log)
    derived = derivations(problem.grammar, 6)
    for found in result.trees:
        posterior = log_posterior(problem, derived, found.tree, found.grounding)
        assert posterior.log == pytest.approx(found.log_posterior)


def test_keeping_trees_changes_nothing_else(rng, make_problem):
    problem = make_problem(rng, goal=6)
    plain, kept = (search(problem, 5, SETTINGS, n_trees=n) for n in (0, 9))
    assert plain.trees == ()
    assert plain.posterior == kept.posterior
    assert plain.history == kept.history
    np.testing.assert_array_equal(plain.grounding, kept.grounding)
