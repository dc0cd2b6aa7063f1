"""The log posterior of a parse tree (III-A), Eq. (3) to (7), up to the constants named here.

Readings taken:
- v_S produces the current fragments. This production is not a cut, so it has no layout term (fragments of different
  objects need not lie together). Its probability in Eq. (4) is the product of p(c|z) over the current fragments, for
  the types c that they have in the tree.
- p(z) in Eq. (5) is omitted; it is equal for all trees of one goal.
- Z in Eq. (7) is taken as 1. It is equal for all groundings of a tree and for all trees with the same number of nodes,
  which are all trees of one goal if every production has two children.
- If the problem has attributes (`grammar-plus`), the terms of `attributes` are added: the choice between terminal and
  production to Eq. (4), and the volume term.
- If a tree has more or fewer terminals than the goal has fragments, only part of it is grounded. Terminals without a
  fragment contribute nothing, and a node without grounded terminals below it is not part of the layout.
"""

from dataclasses import dataclass

import numpy as np

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.inference.attributes import log_stays, log_volume
from cutgrammar.inference.parse_tree import START, TERMINAL, ParseTree
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import Derivations

UNGROUNDED = -1
"""Index of the goal's fragment for terminals that have none."""


@dataclass(frozen=True)
class Posterior:
    """The logs of the three terms of Eq. (3), and of the volume term where the problem has attributes."""

    log_prior: float
    log_shape: float
    log_layout: float
    log_volume: float | None = None

    @property
    def log(self) -> float:
        """Log of Eq. (3) up to its constants."""
        return self.log_prior + self.log_shape + self.log_layout + (self.log_volume or 0.0)


def log_posterior(problem: Problem, derived: Derivations, tree: ParseTree, grounding: Ints) -> Posterior:
    """Log of Eq. (3): how well a grounded parse tree explains the goal.

    Args:
        problem: the goal and the current fragments.
        derived: the derivations of the problem's grammar, which number its productions.
        tree: the parse tree.
        grounding: (t,) index of the goal's fragment for each of the tree's terminals, or `UNGROUNDED`.

    Raises:
        ValueError: the grounding has the wrong length, or two terminals share a fragment.
    """
    used = grounding[grounding != UNGROUNDED]
    if len(grounding) != len(tree.terminals) or len(np.unique(used)) != len(used):
        raise ValueError(f"{grounding} does not ground {len(tree.terminals)} terminals in distinct fragments")
    prior = log_prior(tree, derived.log_probabilities, problem.log_current)
    shape = log_shape(tree, grounding, problem.log_goal)
    attributes = problem.attributes
    layout = 0.0
    if attributes is None or attributes.layout:
        layout = log_layout(tree, grounding, problem.p_WG, problem.layout_length_scale)
    if attributes is None:
        return Posterior(prior, shape, layout)
    return Posterior(prior + log_stays(tree, attributes), shape, layout, log_volume(tree, grounding, attributes))


def log_prior(tree: ParseTree, log_probabilities: Floats, log_current: Floats) -> float:
    """Log of Eq. (4): the product over all productions, including that of v_S.

    Args:
        tree: the parse tree.
        log_probabilities: (p,) log probabilities of the productions, by number.
        log_current: (m, k) log p(c|z) of the current fragments.
    """
    used = tree.productions[tree.productions != TERMINAL]
    roots = tree.roots
    return float(log_probabilities[used].sum() + log_current[np.arange(len(roots)), tree.types[roots]].sum())


def log_shape(tree: ParseTree, grounding: Ints, log_goal: Floats) -> float:
    """Log of Eq. (5) up to log p(z): how well the grounded fragments fit the types of their terminals.

    Args:
        tree: the parse tree.
        grounding: (t,) index of each terminal's fragment, or `UNGROUNDED`.
        log_goal: (g, k) log p(z|c) of the goal's fragments, up to log p(z).
    """
    grounded = grounding != UNGROUNDED
    return float(log_goal[grounding[grounded], tree.types[tree.terminals[grounded]]].sum())


def log_layout(tree: ParseTree, grounding: Ints, p_WG: Floats, layout_length_scale: float) -> float:
    """Log of Eq. (6) up to its constant: how close together the fragments of each production lie.

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
    """Log of Eq. (7) up to its constant: how close together the fragments of one production lie.

    Args:
        p_WC: (m, 3) centres C of the children, in the world frame W [m].
        p_WP: (3,) centre P of their parent, in W [m].
        layout_length_scale: distance at which a fragment becomes e times less likely [m]; the paper gives no unit.

    Raises:
        ValueError: there are no children, an array has the wrong shape, or a centre is not finite.
    """
    if p_WC.ndim != 2 or not len(p_WC) or p_WC.shape[1] != 3 or p_WP.shape != (3,):
        raise ValueError(f"centres of shape {p_WC.shape} about one of shape {p_WP.shape}; (m, 3) and (3,) are needed")
    distances = np.linalg.norm(p_WC - p_WP, axis=1)
    if not np.isfinite(distances).all():
        raise ValueError("a centre is not finite")
    return -float(distances.sum()) / layout_length_scale


def descendants(tree: ParseTree, grounding: Ints, p_WG: Floats) -> tuple[Floats, Ints]:
    """Sum of the centroids (n, 3) [m] and number (n,) of the fragments grounded at or below every node."""
    sums = np.zeros((len(tree.types), 3))
    counts = np.zeros(len(tree.types), dtype=np.int64)
    grounded = grounding != UNGROUNDED
    sums[tree.terminals[grounded]] = p_WG[grounding[grounded]]
    counts[tree.terminals[grounded]] = 1
    for node in range(len(tree.types) - 1, -1, -1):  # in preorder, children come after their parents
        if tree.parents[node] != START:
            sums[tree.parents[node]] += sums[node]
            counts[tree.parents[node]] += counts[node]
    return sums, counts
