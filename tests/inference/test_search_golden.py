"""The trace of one small search, round by round, as readable text."""

import numpy as np
import pytest

from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.text import describe
from cutgrammar.inference.parse_tree import START, TERMINAL
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.search import _Search, search
from cutgrammar.settings import SearchSettings

GRAMMAR = Grammar(
    3,
    {Production(0, (0, 2)): 0.3, Production(0, (1, 1)): 0.5, Production(0, (1, 2)): 0.2, Production(1, (2, 2)): 1.0},
    (0.2, 0.3, 0.5),
)
P_WG = np.array([[0.01, 0.0, 0.0], [0.03, 0.001, 0.0], [0.06, 0.0, 0.002], [0.08, -0.001, 0.0]])
"""Four slices in a row [m]."""
SETTINGS = SearchSettings(max_rounds=16)


@pytest.fixture
def problem():
    shapes = np.log([[0.05, 0.15, 0.8], [0.05, 0.25, 0.7], [0.05, 0.05, 0.9], [0.1, 0.6, 0.3]])
    return Problem(GRAMMAR, np.log([[0.7, 0.2, 0.1]]), shapes, P_WG, layout_length_scale=0.05)


def decision_text(searching, decision, is_start):
    if is_start:
        return "start " + " ".join(f"c{c}" for c in searching.starts[decision])
    return "stop" if decision == TERMINAL else str(searching.derived.productions[decision])


def trace_of(problem, key):
    searching = _Search(problem, np.random.default_rng(key), SETTINGS)
    lines = [describe(problem.grammar), "", "round  visits      score       best  selected; expanded"]
    for number in range(1, SETTINGS.max_rounds + 1):
        if searching.root.explored:
            lines.append("explored completely")
            break
        path, score = searching.play_round()
        texts = [
            ", ".join(decision_text(searching, d, depth == 0 and i == 0) for i, d in enumerate(node.decisions))
            for depth, node in enumerate(path[1:])
        ]
        steps = " / ".join([*texts[:-1], f"+ {texts[-1]}"])
        lines.append(f"{number:5d} {path[-2].visits:7d} {score:10.4f} {searching.highest:10.4f}  {steps}")
    return lines, searching.derived


def tree_lines(result, productions):
    positions = {node: t for t, node in enumerate(result.tree.terminals.tolist())}
    depths = []
    for node, (c, parent) in enumerate(zip(result.tree.types, result.tree.parents, strict=True)):
        depths.append(0 if parent == START else depths[parent] + 1)
        decision = result.tree.productions[node]
        what = f"fragment {result.grounding[positions[node]]}" if decision == TERMINAL else str(productions[decision])
        yield f"{'  ' * depths[-1]}c{c}: {what}"


def test_a_small_search_selects_expands_and_grounds_as_recorded(problem, check_golden):
    lines, derived = trace_of(problem, key=3)
    result = search(problem, 3, SETTINGS)
    lines += ["", "best parse tree and grounding", *tree_lines(result, derived.productions), ""]
    posterior = result.posterior
    lines.append(
        f"log posterior {posterior.log:.4f} = prior {posterior.log_prior:.4f} "
        f"+ shape {posterior.log_shape:.4f} + layout {posterior.log_layout:.4f}"
    )
    check_golden("search.txt", "\n".join(lines))
