"""What is left of a parse tree after one of its cuts: a plan for the next step that competes with those found anew."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from cutgrammar.geometry.fragment import Cloud, Configuration, Mesh
from cutgrammar.inference.attributed_grounding import anneal_attributes
from cutgrammar.inference.draws import draws_from
from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.search import GroundedTree, SearchResult, best_of
from cutgrammar.inference.subtrees import side_by_side, subtree
from cutgrammar.methods.grammar import Plan

MAX_LOG_RATIO = 0.3
"""Fragments whose log volume is further from that of an expected one are not that fragment."""


@dataclass(frozen=True, eq=False)
class LeftOver:
    """The subtrees that a plan leaves when a cut is made, and the fragments that they belong to.

    Attributes:
        goal: the configuration that the plan leads to.
        shapes: of the fragments that are not cut, None for the products of the cut.
        volumes: of all, as expected [m3].
        parts: the parse tree below each.
    """

    goal: Configuration
    shapes: tuple[Mesh | Cloud | None, ...]
    volumes: tuple[float, ...]
    parts: tuple[GroundedTree, ...]

    @staticmethod
    def after(
        plan: Plan, tree: GroundedTree, fragment: int, children: Sequence[int], volumes: Sequence[float]
    ) -> "LeftOver":
        """What is left of `tree` when current fragment `fragment` becomes these nodes of it, with these volumes."""
        others = [i for i in range(len(plan.now)) if i != fragment]
        roots = [int(tree.tree.roots[i]) for i in others]
        return LeftOver(
            plan.goal,
            (*(plan.now[i].shape for i in others), *(None for _ in children)),
            (*(plan.now[i].shape.volume for i in others), *volumes),
            tuple(subtree(tree, node) for node in (*roots, *children)),
        )

    def below(self, now: Configuration) -> GroundedTree | None:
        """The subtrees side by side in the order of the fragments of `now`; None if these are not the expected ones."""
        if len(now) != len(self.parts):
            return None
        found = np.log([fragment.shape.volume for fragment in now])
        costs = np.abs(np.log(self.volumes)[:, None] - found)
        known = np.array([[shape is fragment.shape for fragment in now] for shape in self.shapes])
        rows, columns = linear_sum_assignment(np.where(known, -1.0, costs))
        if costs[rows, columns].max() > MAX_LOG_RATIO:
            return None
        return side_by_side([self.parts[row] for row in rows[np.argsort(columns)]])


def with_left_over(plan: Plan, left: LeftOver | None, swaps_per_terminal: int, rng: np.random.Generator) -> Plan:
    """The plan with the best of its own parse trees and of what is left of the last step's, grounded anew."""
    if left is None or left.goal is not plan.goal or (found := left.below(plan.now)) is None:
        return plan
    n = len(found.tree.terminals)
    grounding, _ = anneal_attributes(found.tree, found.grounding, plan.problem, swaps_per_terminal * n, draws_from(rng))
    posterior = log_posterior(plan.problem, plan.derived, found.tree, grounding)
    tree = GroundedTree(found.tree, grounding, posterior.log)
    missing = abs(n - len(plan.goal))
    kept = SearchResult(found.tree, grounding, posterior, missing, (posterior.log,), 0, 0, (tree,))
    return replace(plan, result=best_of([plan.result, kept]))
