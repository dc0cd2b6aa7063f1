"""How often the search finds the best parse tree and grounding, compared with enumeration on small goals.

Goals have 3 to 6 fragments; a third of them comes from each source:
- `beginnings`: the initial objects of a test demonstration, and the configuration after its first cuts;
- `parts`: a fragment of a test demonstration that is cut into 3 to 6 fragments, and these fragments;
- `grammar`: parse trees sampled from the model's grammar for one or two objects. Each terminal has the features of a
  training fragment that the classifier assigns to its type, and the position of a box that is cut along its longest
  side.

Goals that the grammar cannot derive are counted and drawn again. For all others every parse tree and grounding is
enumerated, with every type possible for every current fragment. The search, with the budget of the settings, succeeds
if its log posterior equals the best that the paper's two steps of grounding allow; the difference to the free optimum
over all groundings is reported too. If the search fails, it is repeated with other keys and with a larger value of one
setting at a time, to find out which of them limits it. The exit code is 1 if it succeeds for less than 95 % of the
goals.

Example:
    python benchmarks/search_exactness.py data model --goals 200 --settings benchmarks/search_exactness.toml
"""

import argparse
import json
import statistics
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
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
from cutgrammar.learning.model import Model, load_model
from cutgrammar.learning.training_fragments import training_fragments
from cutgrammar.methods.grammar import GrammarPlanner
from cutgrammar.seeds import stream
from cutgrammar.settings import SearchSettings, Settings, load_settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.stages.progress import progress
from measures.enumeration import enumerate_all, parse_trees_by_size, tree_of

SIZES = (3, 4, 5, 6)
"""Numbers of fragments of the goals."""
SIDE = 0.05
"""Side length of the boxes that represent objects [m]."""
EQUAL = 1e-9
"""Tolerance for equal log posteriors."""
MORE = 20
"""Factor by which a setting is increased when a failed search is repeated."""


@dataclass(frozen=True)
class Outcome:
    """The result for one goal that the grammar can derive.

    Attributes:
        source: source of the goal.
        goal, now: numbers of goal fragments and current fragments.
        trees: number of enumerated parse trees.
        best, free: log posteriors of the optimum of the two steps and of the free optimum.
        found: log posterior found by the search; None for a dead end.
        rollouts: number of rollouts.
        rounds_needed: number of rounds after which the search reached the best; None if it did not.
        with_more: for a failed search, whether it succeeds with a larger value of each setting.
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
        """Whether the search found the optimum of the two steps."""
        return self.found is not None and self.found >= self.best - EQUAL


@dataclass(frozen=True, eq=False)
class Sources:
    """The sources of goals: the model, the test demonstrations and the features of the training fragments."""

    model: Model
    settings: Settings
    tests: Sequence[Demonstration]
    features: Floats

    @staticmethod
    def of(data: DataSet, model: Model, settings: Settings) -> "Sources":
        """Use the split that the model was trained on."""
        split = read_split(data, model.provenance.split)
        meshes = training_fragments([data.demonstration(t) for t in model.provenance.trials]).meshes
        features = np.array([model.features(mesh) for mesh in meshes])
        return Sources(model, settings, [data.demonstration(t) for t in split.test], features)


Task = tuple[Problem, tuple[int, ...]]
"""A problem and the keys of its searches."""
Draw = Callable[[Sources, int, np.random.Generator], tuple[Task, SearchResult] | None]
"""Draws a goal of a given size and runs the search; None if no production applies."""


def beginning(sources: Sources, size: int, rng: np.random.Generator) -> tuple[Task, SearchResult] | None:
    """The first cuts of a test demonstration."""
    candidates = [d for d in sources.tests if len(d.start) < size and size in _sizes(d)]
    chosen = candidates[int(rng.integers(len(candidates)))]
    return _planned(sources, chosen.start, chosen.configuration(_sizes(chosen).index(size)), rng)


def part(sources: Sources, size: int, rng: np.random.Generator) -> tuple[Task, SearchResult] | None:
    """A fragment of a test demonstration and the goal fragments that it was cut into."""
    candidates = [(d, f.id) for d in sources.tests for f in d.fragments if len(_final_fragments(d, f.id)) == size]
    chosen, fragment = candidates[int(rng.integers(len(candidates)))]
    now = (chosen.fragment_at(chosen.fragments[fragment].step, fragment),)
    goal = tuple(chosen.fragment_at(chosen.steps, final) for final in _final_fragments(chosen, fragment))
    return _planned(sources, now, goal, rng)


def from_grammar(sources: Sources, size: int, rng: np.random.Generator) -> tuple[Task, SearchResult] | None:
    """A parse tree sampled from the grammar, with features and positions for its terminals."""
    model, settings = sources.model, sources.settings.search
    now = int(rng.integers(1, 3))
    tree = _sample_tree(model, size, now, rng)
    log_types = model.classifier.log_probabilities(sources.features)

    def log_types_like(types: Iterable[int]) -> Floats:
        """(n, k) log p(c|z) of random training fragments with these types."""
        likely = np.exp(log_types)
        return log_types[[int(rng.choice(len(likely), p=likely[:, c] / likely[:, c].sum())) for c in types]]

    log_goal = shape_likelihood(
        log_types_like(tree.types[tree.terminals]), model.grammar, settings.divide_by_type_prior
    )
    length_scale = settings.layout_length_scale * SIDE * now ** (1.0 / 3.0)
    order = rng.permutation(size)
    problem = Problem(
        model.grammar,
        log_types_like(tree.types[tree.roots]),
        log_goal[order],
        _positions(tree, rng)[order],
        length_scale,
    )
    keys = tuple(int(key) for key in rng.integers(0, 2**63, size=settings.n_searches))
    return (problem, keys), _search(problem, keys, settings)


DRAWS: dict[str, Draw] = {"beginnings": beginning, "parts": part, "grammar": from_grammar}


def _sizes(demonstration: Demonstration) -> list[int]:
    """Numbers of fragments after every step."""
    return [len(demonstration.alive(step)) for step in range(demonstration.steps + 1)]


def _final_fragments(demonstration: Demonstration, fragment: int) -> list[int]:
    """The final fragments that a fragment was cut into, ascending; the fragment itself if it was not cut."""
    cut = {c.fragment: c.products for c in demonstration.cuts if not c.undone}
    if fragment not in cut:
        return [fragment] if fragment in demonstration.alive(demonstration.steps) else []
    return sorted(final for product in cut[fragment] for final in _final_fragments(demonstration, product))


def _planned(
    sources: Sources, now: Configuration, goal: Configuration, rng: np.random.Generator
) -> tuple[Task, SearchResult] | None:
    """Run the planner of the method `grammar`; return its inference problem and its search result."""
    seen: list[tuple[Task, SearchResult]] = []

    def spread(function: Any, arguments: Iterable[Any]) -> list[Any]:
        keys = tuple(arguments)
        found = [function(key) for key in keys]
        seen.append(((function.args[0], keys), best_of(found)))
        return found

    planner = GrammarPlanner(sources.model, sources.settings, parallel_map=spread)
    cut = planner.next_cut(now, goal, (), rng)
    return None if isinstance(cut, Stuck) else seen[0]


def _sample_tree(model: Model, size: int, now: int, rng: np.random.Generator) -> ParseTree:
    """Sample a parse tree of `size` terminals: root types by their frequency, productions from the prior (Eq. 4)."""
    derived = derivations(model.grammar, size)
    table = parse_trees_by_size(derived.productions, model.grammar.k, size)
    shares = 1 + rng.multinomial(size - now, np.full(now, 1.0 / now))
    roots, rows = [], []
    for share in shares.tolist():
        options = [(c, row) for c in range(model.grammar.k) for row in table[c, share]]
        weights = np.array([model.grammar.frequencies[c] * derived.probabilities[r[r >= 0]].prod() for c, r in options])
        c, row = options[int(rng.choice(len(options), p=weights / weights.sum()))]
        roots.append(c)
        rows.append(row)
    return tree_of(derived.productions, np.array(roots), np.concatenate(rows))


def _positions(tree: ParseTree, rng: np.random.Generator) -> Floats:
    """(t, 3) centres of the terminals if all fragments are boxes that are cut across their longest side [m]."""
    boxes: dict[int, Floats] = {}  # lower and upper corners
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


def _search(problem: Problem, keys: Iterable[int], settings: SearchSettings) -> SearchResult:
    return best_of([search(problem, key, settings) for key in keys])


def _rounds_needed(found: SearchResult, best: float) -> int | None:
    reached = [round_ for round_, score in enumerate(found.history, start=1) if score >= best - EQUAL]
    return reached[0] if reached and not found.missing else None


def _repeat(missed: Outcome, task: Task, settings: SearchSettings) -> Outcome:
    """Repeat a failed search with other keys, and with a larger value of one setting at a time."""
    problem, keys = task
    tries = {
        "other keys": (tuple(key ^ 1 for key in keys), settings),
        "rounds": (keys, replace(settings, max_rounds=MORE * settings.max_rounds)),
        "starts": (keys, replace(settings, n_starts=MORE * settings.n_starts)),
        "swaps": (keys, replace(settings, swaps_per_terminal=MORE * settings.swaps_per_terminal)),
    }
    needed = {name: _rounds_needed(_search(problem, *changed), missed.best) for name, changed in tries.items()}
    reached = {name: rounds is not None for name, rounds in needed.items()}
    return replace(missed, rounds_needed=needed["rounds"], with_more=reached)


def outcome(sources: Sources, source: str, size: int, rng: np.random.Generator, why: bool) -> Outcome | None:
    """Draw a goal, run search and enumeration, and compare; None for a goal that the grammar cannot derive."""
    drawn = DRAWS[source](sources, size, rng)
    if drawn is None:
        return None
    (problem, keys), found = drawn
    enumerated = enumerate_all(problem)
    if enumerated is None:
        return None
    best = enumerated.two_steps.posterior.log
    result = Outcome(
        source=source,
        goal=size,
        now=len(problem.log_current),
        trees=enumerated.trees,
        best=best,
        free=enumerated.free.posterior.log,
        found=None if found.missing else found.posterior.log,
        rollouts=found.rollouts,
        rounds_needed=_rounds_needed(found, best),
        with_more={},
    )
    if result.found is not None and result.found > result.best + EQUAL:
        raise AssertionError(f"the search found {result.found}, better than the enumerated optimum {result.best}")
    if result.reached or not why:
        return result
    return _repeat(result, (problem, keys), sources.settings.search)


def table_of(outcomes: Sequence[Outcome]) -> str:
    """One line per source and size, and one for all goals."""
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
    """Draw goals, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="a data set with a split")
    parser.add_argument("model", type=Path, help="a model trained on it")
    parser.add_argument("--goals", type=int, default=200, help="number of goals")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--settings", type=Path, help="a TOML file, whose table [search] is the budget")
    parser.add_argument("--json", type=Path, help="file for all results")
    parser.add_argument("--no-why", action="store_true", help="do not repeat failed searches")
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
                print(f"the grammar cannot derive any of 1000 goals of {size} fragments ({source})", file=sys.stderr)
                return 2
            advance()
    budget = sources.settings.search
    share = float(np.mean([o.reached for o in outcomes]))
    missed = [o for o in outcomes if not o.reached]
    print(f"budget: {budget}")
    print(table_of(outcomes))
    print(f"drawn again because the grammar cannot derive them: {underivable}")
    if missed and not options.no_why:
        fixed = {name: sum(o.with_more[name] for o in missed) for name in missed[0].with_more}
        print(f"of {len(missed)} failures, success with other keys or {MORE} times a setting: {fixed}")
        within = {
            rounds: np.mean([o.rounds_needed is not None and o.rounds_needed <= rounds for o in outcomes])
            for rounds in (times * budget.max_rounds for times in (1, 2, 5, 10, MORE))
        }
        shares = ", ".join(f"{rounds}: {100.0 * reached:.1f} %" for rounds, reached in within.items())
        print(f"success within this number of rounds of each search: {shares}")
    print(f"success: {100.0 * share:.1f} % of {len(outcomes)} (target: 95 %)")
    if options.json:
        facts = {
            "seed": options.seed,
            "search": asdict(budget),
            "data": sources.model.provenance.data,
            "reached": share,
            "underivable": underivable,
            "goals": [{**asdict(o), "reached": o.reached} for o in outcomes],
        }
        options.json.write_text(json.dumps(facts, indent=1) + "\n")
    return 0 if share >= 0.95 else 1


if __name__ == "__main__":
    sys.exit(main())
