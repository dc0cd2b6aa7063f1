"""The posterior of a parse tree (III-A), Eq. (3) to (7), in logs and up to the constants named here.

Readings taken. v_S produces the current fragments; that production is no cut, so it is not part of the layout term
(the fragments of several objects need not lie together), and its probability in Eq. (4) is that of the types drawn for
the current fragments, the product of their p(c|z). Left out: p(z) in Eq. (5), which is equal for all trees of one goal,
and Z in Eq. (7), which is equal for all groundings of a tree and for all trees with as many nodes; those are all trees
of one goal where every production has two children, and elsewhere Z counts as 1. A tree with another number of
terminals than the goal has fragments is grounded in part: terminals without a fragment count for nothing, and a node
without grounded terminals below it has no place in the layout.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import Derivations

UNGROUNDED = -1
"""Stands for the goal's fragment where a terminal has none."""


@dataclass(frozen=True)
class Posterior:
    """The three terms of Eq. (3) in logs."""

    log_prior: float
    log_shape: float
    log_layout: float

    @property
    def log(self) -> float:
        """Log of Eq. (3) up to its constants."""
        return self.log_prior + self.log_shape + self.log_layout


def log_posterior(problem: Problem, known: Derivations, tree: ParseTree, grounding: Ints) -> Posterior:
    """Log of Eq. (3): how well a grounded parse tree explains the goal.

    Args:
        problem: the goal and the current fragments.
        known: of the problem's grammar; numbers its productions.
        tree: the parse tree.
        grounding: (t,) index of the goal's fragment for each of the tree's terminals, or `UNGROUNDED`.

    Raises:
        ValueError: a grounding of another length, or a fragment that two terminals share.
    """
    used = grounding[grounding != UNGROUNDED]
    if len(grounding) != len(tree.terminals) or len(np.unique(used)) != len(used):
        raise ValueError(f"{grounding} does not ground {len(tree.terminals)} terminals in different fragments")
    return Posterior(
        log_prior(tree, known.log_probabilities, problem.log_current),
        log_shape(tree, grounding, problem.log_goal),
        log_layout(tree, grounding, problem.p_WG, problem.layout_length_scale),
    )


def log_prior(tree: ParseTree, log_probabilities: Floats, log_current: Floats) -> float:
    """Log of Eq. (4), the product over all productions, v_S's included.

    Args:
        tree: the parse tree.
        log_probabilities: (p,) of the productions by number.
        log_current: (m, k) log p(c|z) of the current fragments.
    """
    used = tree.productions[tree.productions != TERMINAL]
    roots = tree.roots
    return float(log_probabilities[used].sum() + log_current[np.arange(len(roots)), tree.types[roots]].sum())


def log_shape(tree: ParseTree, grounding: Ints, log_goal: Floats) -> float:
    """Log of Eq. (5) up to log p(z): how well the grounded fragments fit their terminals' types.

    Args:
        tree: the parse tree.
        grounding: (t,) index of each terminal's fragment, or `UNGROUNDED`.
        log_goal: (g, k) log p(z|c) of the goal's fragments, up to log p(z).
    """
    grounded = grounding != UNGROUNDED
    return float(log_goal[grounding[grounded], tree.types[tree.terminals[grounded]]].sum())


def log_layout(tree: ParseTree, grounding: Ints, p_WG: Floats, layout_length_scale: float) -> float:
    """Log of Eq. (6) up to its constant: how readily the fragments of every production lie together.

    Args:
        tree: the parse tree.
        grounding: (t,) index of each terminal's fragment, or `UNGROUNDED`.
        p_WG: (g, 3) centroids of the goal's fragments in W [m].
        layout_length_scale: as in `log_grouping` [m].
    """
    sums, counts = descendants(tree, grounding, p_WG)
    total = 0.0
    for node in np.flatnonzero(tree.productions != TERMINAL):
        children = tree.children(int(node))
        children = children[counts[children] > 0]
        if len(children):
            centres = sums[children] / counts[children, None]
            total += log_grouping(centres, sums[node] / counts[node], layout_length_scale)
    return total


def log_grouping(p_WC: Floats, p_WP: Floats, layout_length_scale: float) -> float:
    """How readily the fragments of one production lie together: the log of Eq. (7), up to its constant.

    Args:
        p_WC: (m, 3) centres C of the produced nodes, in the world frame W [m].
        p_WP: (3,) centre P of the node they came from, in W [m].
        layout_length_scale: distance at which a fragment becomes e times less likely [m]; the paper gives no unit.

    Raises:
        ValueError: no fragments, a shape that does not fit, or a centre that is not finite.
    """
    if p_WC.ndim != 2 or not len(p_WC) or p_WC.shape[1] != 3 or p_WP.shape != (3,):
        raise ValueError(f"centres of shape {p_WC.shape} about one of shape {p_WP.shape}; (m, 3) and (3,) are needed")
    distances = np.linalg.norm(p_WC - p_WP, axis=1)
    if not np.isfinite(distances).all():
        raise ValueError("a centre is not finite")
    return -float(distances.sum()) / layout_length_scale


def descendants(tree: ParseTree, grounding: Ints, p_WG: Floats) -> tuple[Floats, Ints]:
    """Sum (n, 3) [m] and number (n,) of the fragments grounded below every node, each found once from its children."""
    sums = np.zeros((len(tree.types), 3))
    counts = np.zeros(len(tree.types), dtype=np.int64)
    grounded = grounding != UNGROUNDED
    sums[tree.terminals[grounded]] = p_WG[grounding[grounded]]
    counts[tree.terminals[grounded]] = 1
    for node in range(len(tree.types) - 1, -1, -1):  # preorder: children stand after their parents
        if tree.parents[node] != START:
            sums[tree.parents[node]] += sums[node]
            counts[tree.parents[node]] += counts[node]
    return sums, counts
