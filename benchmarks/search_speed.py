"""How many rollouts a second the search for the best parse tree makes, annealing included.

    python benchmarks/search_speed.py [ROUNDS]

Random grammars of 8 types and 40 productions, one current fragment, goals of 8 to 64 fragments; CPU time of one core.
"""

import sys
import time

import numpy as np

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.search import search
from cutgrammar.settings import SearchSettings


def random_problem(rng: np.random.Generator, goal: int, types: int = 8, productions: int = 40) -> Problem:
    """A goal of `goal` fragments, a random grammar, and types that are known fairly well."""
    weights: dict[Production, float] = {}
    while len(weights) < productions:
        parent, *children = (int(c) for c in rng.integers(types, size=3))
        weights[Production(parent, tuple(children))] = rng.uniform(0.1, 1.0)
    totals = {p.parent: sum(w for q, w in weights.items() if q.parent == p.parent) for p in weights}
    grammar = Grammar(types, {p: w / totals[p.parent] for p, w in weights.items()}, (1.0 / types,) * types)
    now, there = (np.log(rng.dirichlet(np.full(types, 0.3), size=n) + 1e-6) for n in (1, goal))
    return Problem(grammar, now, there, 0.05 * rng.normal(size=(goal, 3)), layout_length_scale=0.05)


def main() -> None:
    """Print a table."""
    settings = SearchSettings(max_rounds=int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
    rng = np.random.default_rng(0)
    began = time.perf_counter()
    search(random_problem(rng, 4), 0, SearchSettings(max_rounds=5))
    print(f"loading or compiling: {time.perf_counter() - began:.1f} s")
    print("goal fragments   rollouts/s   log posterior")
    for goal in (8, 16, 32, 64):
        problem = random_problem(rng, goal)
        began = time.process_time()
        found = search(problem, 0, settings)
        seconds = time.process_time() - began
        print(f"{goal:14d}   {found.rollouts / seconds:10,.0f}   {found.posterior.log:13.2f}")


if __name__ == "__main__":
    main()
