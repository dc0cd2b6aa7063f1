"""Does the search reach the best parse tree and grounding that there is? Small goals, compared with enumeration.

    python benchmarks/search_exactness.py DATA MODEL [--goals 200] [--seed 0] [--settings FILE.toml] [--json FILE]

Goals of 3 to 6 fragments, a third each:
- `beginnings`: a test demonstration's initial objects, and what its first cuts had made of them;
- `parts`: a fragment of a test demonstration with 3 to 6 pieces in the end, and those pieces;
- `grammar`: parse trees drawn from the model's grammar for one or two objects, each terminal with the features of a
  training fragment that the classifier takes for its type, laid where boxes halved along their longest side would lie.
Those that the grammar cannot derive are dead ends, counted, and others are drawn in their place. For the rest all parse
trees and all groundings are enumerated, every type possible for every current fragment. A search with the settings'
budget reaches the best if its log posterior is that of the best which the paper's two steps of grounding allow; how
much better the free optimum over all groundings is, is told beside it. Where the search missed, it is repeated with
other keys, and with more of one thing, to tell what it lacked.
"""

import argparse
import dataclasses
import json
import statistics
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.inference.parse_tree import START, ParseTree
from cutgrammar.inference.problem import Problem, shape_likelihood
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import SearchResult, best_of, search
from cutgrammar.interfaces import Stuck
from cutgrammar.learning.learn import training_fragments
from cutgrammar.learning.model import Model, load_model
from cutgrammar.methods.grammar import GrammarPlanner
from cutgrammar.seeds import stream
from cutgrammar.settings import SearchSettings, Settings, load_settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.stages.progress import progress
from measures.enumeration import enumerate_all, parse_trees_by_size, tree_of

SIZES = (3, 4, 5, 6)
"""How many fragments goals have."""
SIDE = 0.05
"""Length of an object's side where boxes stand for fragments [m]."""
EQUAL = 1e-9
"""Log posteriors that differ by no more than this are equal."""
MORE = 20
"""How many times as much of one thing a search is given that missed."""


@dataclass(frozen=True)
class Outcome:
    """One goal that the grammar can derive.

    Attributes:
        source: where it was drawn from.
        goal, now: numbers of fragments.
        trees: parse trees enumerated.
        best, free: log posterior of the two optima.
        found: log posterior that the search found; None for a dead end.
        rollouts: that it made.
        rounds_needed: after which round of its searches it had reached the best; None where it never did.
        with_more: where it missed, whether it reached the best with more of each thing.
    """

    source: str
    goal: int
    now: int
    trees: int
    best: float
    free: float
    found: float | None
    rollouts: int
    rounds_needed: int | None
    with_more: dict[str, bool]

    @property
    def reached(self) -> bool:
        """The search found the best there is."""
        return self.found is not None and self.found >= self.best - EQUAL


@dataclass(frozen=True, eq=False)
class Sources:
    """What goals are drawn from: the model, the test demonstrations and the features of the training fragments."""

    model: Model
    settings: Settings
    tests: Sequence[Demonstration]
    features: Floats

    @staticmethod
    def of(data: DataSet, model: Model, settings: Settings) -> "Sources":
        """From the split that the model was trained on."""
        split = read_split(data, model.provenance.split)
        meshes = training_fragments([data.demonstration(t) for t in model.provenance.trials]).meshes
        features = np.array([model.features(mesh) for mesh in meshes])
        return Sources(model, settings, [data.demonstration(t) for t in split.test], features)


Task = tuple[Problem, tuple[int, ...]]
"""A problem and the keys of its searches."""
Draw = Callable[[Sources, int, np.random.Generator], tuple[Task, SearchResult] | None]
"""Draws a goal of a size and searches it; None where no production applies."""


def beginning(sources: Sources, size: int, rng: np.random.Generator) -> tuple[Task, SearchResult] | None:
    """The first cuts of a test demonstration."""
    able = [d for d in sources.tests if len(d.start) < size and size in _sizes(d)]
    chosen = able[int(rng.integers(len(able)))]
    return _planned(sources, chosen.start, chosen.configuration(_sizes(chosen).index(size)), rng)


def part(sources: Sources, size: int, rng: np.random.Generator) -> tuple[Task, SearchResult] | None:
    """A fragment of a test demonstration and what became of it."""
    able = [(d, f.id) for d in sources.tests for f in d.fragments if len(_pieces(d, f.id)) == size]
    chosen, fragment = able[int(rng.integers(len(able)))]
    now = (chosen.fragment_at(chosen.fragments[fragment].step, fragment),)
    goal = tuple(chosen.fragment_at(chosen.steps, piece) for piece in _pieces(chosen, fragment))
    return _planned(sources, now, goal, rng)


def from_grammar(sources: Sources, size: int, rng: np.random.Generator) -> tuple[Task, SearchResult] | None:
    """A parse tree drawn from the grammar, dressed in features and places."""
    model, settings = sources.model, sources.settings.search
    now = int(rng.integers(1, 3))
    tree = _drawn_tree(model, size, now, rng)
    log_types = model.classifier.log_probabilities(sources.features)

    def as_seen(types: Iterable[int]) -> Floats:
        """(n, k) log p(c|z) of training fragments that look like these types."""
        likely = np.exp(log_types)
        return log_types[[int(rng.choice(len(likely), p=likely[:, c] / likely[:, c].sum())) for c in types]]

    log_goal = shape_likelihood(as_seen(tree.types[tree.terminals]), model.grammar, settings.divide_by_type_prior)
    length_scale = settings.layout_length_scale * SIDE * now ** (1.0 / 3.0)
    order = rng.permutation(size)
    problem = Problem(
        model.grammar, as_seen(tree.types[tree.roots]), log_goal[order], _laid(tree, rng)[order], length_scale
    )
    keys = tuple(int(key) for key in rng.integers(0, 2**63, size=settings.n_searches))
    return (problem, keys), _searched(problem, keys, settings)


DRAWS: dict[str, Draw] = {"beginnings": beginning, "parts": part, "grammar": from_grammar}


def _sizes(demonstration: Demonstration) -> list[int]:
    """Number of fragments after every step."""
    return [len(demonstration.alive(step)) for step in range(demonstration.steps + 1)]


def _pieces(demonstration: Demonstration, fragment: int) -> list[int]:
    """The final fragments that a fragment became, ascending; itself if it was never cut."""
    cut = {c.fragment: c.products for c in demonstration.cuts if not c.undone}
    if fragment not in cut:
        return [fragment] if fragment in demonstration.alive(demonstration.steps) else []
    return sorted(piece for product in cut[fragment] for piece in _pieces(demonstration, product))


def _planned(
    sources: Sources, now: Configuration, goal: Configuration, rng: np.random.Generator
) -> tuple[Task, SearchResult] | None:
    """What the planner of the method `grammar` makes of a goal: the problem as it sees it, and what it found."""
    seen: list[tuple[Task, SearchResult]] = []

    def spread(function: Any, arguments: Iterable[Any]) -> list[Any]:
        keys = tuple(arguments)
        found = [function(key) for key in keys]
        seen.append(((function.args[0], keys), best_of(found)))
        return found

    planner = GrammarPlanner(sources.model, sources.settings, parallel_map=spread)
    cut = planner.next_cut(now, goal, (), rng)
    return None if isinstance(cut, Stuck) else seen[0]


def _drawn_tree(model: Model, size: int, now: int, rng: np.random.Generator) -> ParseTree:
    """A parse tree of `size` terminals: objects' types by their frequency, productions by the prior (Eq. 4)."""
    known = derivations(model.grammar, size)
    table = parse_trees_by_size(known.productions, model.grammar.k, size)
    shares = 1 + rng.multinomial(size - now, np.full(now, 1.0 / now))
    roots, rows = [], []
    for share in shares.tolist():
        options = [(c, row) for c in range(model.grammar.k) for row in table[c, share]]
        weights = np.array([model.grammar.frequencies[c] * known.probabilities[r[r >= 0]].prod() for c, r in options])
        c, row = options[int(rng.choice(len(options), p=weights / weights.sum()))]
        roots.append(c)
        rows.append(row)
    return tree_of(known.productions, np.array(roots), np.concatenate(rows))


def _laid(tree: ParseTree, rng: np.random.Generator) -> Floats:
    """(t, 3) centres of the terminals, were every fragment a box, cut across its longest side [m]."""
    boxes: dict[int, Floats] = {}  # lower and upper corner
    for i, root in enumerate(tree.roots.tolist()):
        boxes[root] = SIDE * np.array([[2.0 * i, 0.0, 0.0], [2.0 * i + 1.0, 1.0, 1.0]])
    for node in range(len(tree.types)):
        children = tree.children(node)
        axis = int(np.argmax(boxes[node][1] - boxes[node][0]))
        low, high = boxes[node][:, axis]
        edges = low + (high - low) * (np.arange(len(children) + 1) / max(len(children), 1))
        edges[1:-1] += 0.1 * (high - low) * rng.normal(size=max(len(children) - 1, 0)).clip(-2.0, 2.0)
        for child, start, end in zip(children.tolist(), edges[:-1], edges[1:], strict=True):
            box = boxes[node].copy()
            box[:, axis] = start, end
            boxes[child] = box
    assert np.all(tree.parents[tree.roots] == START)
    return np.array([boxes[t].mean(axis=0) for t in tree.terminals.tolist()])


def _searched(problem: Problem, keys: Iterable[int], settings: SearchSettings) -> SearchResult:
    return best_of([search(problem, key, settings) for key in keys])


def _rounds_needed(found: SearchResult, best: float) -> int | None:
    reached = [round_ for round_, score in enumerate(found.history, start=1) if score >= best - EQUAL]
    return reached[0] if reached and not found.missing else None


def _tried_again(missed: Outcome, task: Task, settings: SearchSettings) -> Outcome:
    """Whether the search reaches the best with other keys, or with more of one thing; after how many rounds."""
    problem, keys = task
    with_more = dataclasses.replace
    tries = {
        "other keys": (tuple(key ^ 1 for key in keys), settings),
        "rounds": (keys, with_more(settings, max_rounds=MORE * settings.max_rounds)),
        "starts": (keys, with_more(settings, n_starts=MORE * settings.n_starts)),
        "swaps": (keys, with_more(settings, swaps_per_terminal=MORE * settings.swaps_per_terminal)),
    }
    needed = {name: _rounds_needed(_searched(problem, *what), missed.best) for name, what in tries.items()}
    reached = {name: rounds is not None for name, rounds in needed.items()}
    return with_more(missed, rounds_needed=needed["rounds"], with_more=reached)


def outcome(sources: Sources, source: str, size: int, rng: np.random.Generator, why: bool) -> Outcome | None:
    """Draw a goal, search it, and enumerate it; None for one that the grammar cannot derive."""
    drawn = DRAWS[source](sources, size, rng)
    if drawn is None:
        return None
    (problem, keys), found = drawn
    all_there_is = enumerate_all(problem)
    if all_there_is is None:
        return None
    best = all_there_is.two_steps.posterior.log
    result = Outcome(
        source=source,
        goal=size,
        now=len(problem.log_current),
        trees=all_there_is.trees,
        best=best,
        free=all_there_is.free.posterior.log,
        found=None if found.missing else found.posterior.log,
        rollouts=found.rollouts,
        rounds_needed=_rounds_needed(found, best),
        with_more={},
    )
    if result.found is not None and result.found > result.best + EQUAL:
        raise AssertionError(f"the search found {result.found}, better than the best of all, {result.best}")
    if result.reached or not why:
        return result
    return _tried_again(result, (problem, keys), sources.settings.search)


def table_of(outcomes: Sequence[Outcome]) -> str:
    """One line a source and size, and one for all."""
    lines = [
        "goals        size    n  reached   short of best   parse trees      rollouts   free optimum better: share, by"
    ]
    groups = [(s, (n,)) for s in DRAWS for n in SIZES] + [(s, SIZES) for s in DRAWS] + [("all", SIZES)]
    for source, sizes in groups:
        rows = [o for o in outcomes if o.goal in sizes and source in (o.source, "all")]
        if not rows:
            continue
        short = [o.best - o.found for o in rows if o.found is not None and not o.reached]
        gaps = [o.free - o.best for o in rows]
        trees = [o.trees for o in rows]
        lines.append(
            f"{source:11s} {sizes[0] if len(sizes) == 1 else 'all':>5} {len(rows):4d} "
            f"{100.0 * np.mean([o.reached for o in rows]):7.1f}% {statistics.fmean(short) if short else 0.0:15.3f} "
            f"{statistics.median(trees):6.0f} to {max(trees):7d} {statistics.fmean(o.rollouts for o in rows):7.0f} "
            f"{100.0 * np.mean([gap > EQUAL for gap in gaps]):28.1f}%, {statistics.fmean(gaps):.3f}"
        )
    return "\n".join(lines)


def main() -> int:
    """Draw goals, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--settings", type=Path, help="a TOML file; its table [search] is the budget")
    parser.add_argument("--json", type=Path, help="where to write every outcome")
    parser.add_argument("--no-why", action="store_true", help="do not repeat the searches that missed")
    options = parser.parse_args()
    try:
        sources = Sources.of(DataSet.open(options.data), load_model(options.model), load_settings(options.settings))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    outcomes: list[Outcome] = []
    underivable = dict.fromkeys(DRAWS, 0)
    with progress("goals", options.goals) as advance:
        for i in range(options.goals):
            source, size = list(DRAWS)[i % len(DRAWS)], SIZES[i // len(DRAWS) % len(SIZES)]
            for attempt in range(1000):
                rng = stream(options.seed, "search exactness", i, attempt)
                found = outcome(sources, source, size, rng, not options.no_why)
                if found is not None:
                    outcomes.append(found)
                    break
                underivable[source] += 1
            else:
                print(f"the grammar derives none of 1000 goals of {size} fragments ({source})", file=sys.stderr)
                return 2
            advance()
    budget = sources.settings.search
    share = float(np.mean([o.reached for o in outcomes]))
    missed = [o for o in outcomes if not o.reached]
    print(f"budget: {budget}")
    print(table_of(outcomes))
    print(f"drawn anew because the grammar cannot derive them: {underivable}")
    if missed and not options.no_why:
        fixed = {name: sum(o.with_more[name] for o in missed) for name in missed[0].with_more}
        print(f"of {len(missed)} missed, reached with other keys or {MORE} times as many: {fixed}")
        within = {
            rounds: np.mean([o.rounds_needed is not None and o.rounds_needed <= rounds for o in outcomes])
            for rounds in (times * budget.max_rounds for times in (1, 2, 5, 10, MORE))
        }
        told = ", ".join(f"{rounds}: {100.0 * reached:.1f} %" for rounds, reached in within.items())
        print(f"reached within so many rounds of each search: {told}")
    print(f"reached the best: {100.0 * share:.1f} % of {len(outcomes)} (wanted: 95 %)")
    if options.json:
        facts = {
            "seed": options.seed,
            "search": dataclasses.asdict(budget),
            "data": sources.model.provenance.data,
            "reached": share,
            "underivable": underivable,
            "goals": [{**dataclasses.asdict(o), "reached": o.reached} for o in outcomes],
        }
        options.json.write_text(json.dumps(facts, indent=1) + "\n")
    return 0 if share >= 0.95 else 1


if __name__ == "__main__":
    sys.exit(main())
