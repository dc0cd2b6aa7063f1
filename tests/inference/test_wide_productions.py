"""Productions with more than two children, which occur for bent foods, are planned like any other."""

import numpy as np
import pytest

from brute_force import best_by_enumeration
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import best_of, search
from cutgrammar.settings import SearchSettings

BANANA, CROWN, TIP, SLICE = range(4)
IN_THREE, IN_TWO = Production(BANANA, (CROWN, TIP, TIP)), Production(BANANA, (CROWN, CROWN))
HALVED = Production(CROWN, (SLICE, SLICE))
GRAMMAR = Grammar(4, {IN_THREE: 0.4, IN_TWO: 0.6, HALVED: 1.0}, (0.25,) * 4)


def log_types(*types):
    """(n, 4) log probabilities of fragments whose types are almost certain."""
    return np.log(0.97 * np.eye(4)[list(types)] + 0.01)


def problem_of(*goal):
    return Problem(GRAMMAR, log_types(BANANA), log_types(*goal), np.arange(3 * len(goal)).reshape(-1, 3) / 100.0, 0.1)


@pytest.mark.parametrize(
    ("goal", "productions"),
    [
        ((TIP, CROWN, TIP), [IN_THREE]),
        ((TIP, SLICE, SLICE, TIP), [IN_THREE, HALVED]),
        ((SLICE, CROWN, SLICE), [IN_TWO, HALVED]),
    ],
)
def test_search_and_brute_force_use_a_wide_production_if_the_goal_requires_it(goal, productions):
    problem = problem_of(*goal)
    found = best_of([search(problem, key, SearchSettings(max_rounds=60)) for key in range(2)])
    table = derivations(GRAMMAR, len(goal))
    taken = [table.productions[i] for i in found.tree.productions if i >= 0]
    assert taken == productions
    assert found.missing == 0
    assert sorted(found.grounding) == list(range(len(goal)))
    assert found.posterior.log == pytest.approx(best_by_enumeration(problem, table, [(BANANA,)])[0].log)
