"""Random grammars and problems for the tests of the inference."""

import numpy as np
import pytest

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import Problem


def random_grammar(rng, k=4, productions=8, max_children=2):
    weights = {}
    while len(weights) < productions:
        parent = int(rng.integers(k - 1))  # the last type is never cut
        children = rng.integers(0, k, size=int(rng.integers(2, max_children + 1)))
        weights[Production(parent, tuple(int(c) for c in children))] = rng.uniform(0.1, 1.0)
    totals = {p.parent: sum(w for q, w in weights.items() if q.parent == p.parent) for p in weights}
    probabilities = {p: w / totals[p.parent] for p, w in weights.items()}
    return Grammar(k, probabilities, tuple(rng.dirichlet(np.full(k, 5.0))))


def log_shares(rng, n, k):
    raw = 2.0 * rng.normal(size=(n, k))
    return raw - np.log(np.exp(raw).sum(axis=1, keepdims=True))


def random_problem(rng, goal=5, now=1, grammar=None, layout_length_scale=0.05):
    grammar = grammar or random_grammar(rng)
    return Problem(
        grammar=grammar,
        log_current=log_shares(rng, now, grammar.k),
        log_goal=log_shares(rng, goal, grammar.k),
        p_WG=0.05 * rng.normal(size=(goal, 3)),
        layout_length_scale=layout_length_scale,
    )


@pytest.fixture
def make_grammar():
    """Makes a random grammar whose last type is never cut."""
    return random_grammar


@pytest.fixture
def make_problem():
    """Makes a random problem."""
    return random_problem
