"""Speed of the search for the best parse tree in rollouts per second, including annealing.

The grammars are random, with 8 types and 40 productions; there is one current fragment, and goals have 8 to 64
fragments. Times are CPU times of one core.

Example:
    python benchmarks/search_speed.py --rounds 1000
"""

import argparse
import time

import numpy as np

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.search import search
from cutgrammar.settings import SearchSettings


def random_problem(rng: np.random.Generator, goal: int, types: int = 8, productions: int = 40) -> Problem:
    """A problem with a goal of `goal` fragments, a random grammar, and fairly certain types."""
    weights: dict[Production, float] = {}
    while len(weights) < productions:
        parent, *children = (int(c) for c in rng.integers(types, size=3))
        weights[Production(parent, tuple(children))] = rng.uniform(0.1, 1.0)
    totals = {p.parent: sum(w for q, w in weights.items() if q.parent == p.parent) for p in weights}
    grammar = Grammar(types, {p: w / totals[p.parent] for p, w in weights.items()}, (1.0 / types,) * types)
    log_current, log_goal = (np.log(rng.dirichlet(np.full(types, 0.3), size=n) + 1e-6) for n in (1, goal))
    return Problem(grammar, log_current, log_goal, 0.05 * rng.normal(size=(goal, 3)), layout_length_scale=0.05)


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=1000, help="rounds of each search")
    settings = SearchSettings(max_rounds=parser.parse_args().rounds)
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
