"""The input of a search: the grammar, and the network outputs for the current fragments and the goal.

A `Problem` is small and contains no network, so it is cheap to send to workers.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats, frozen_floats
from cutgrammar.grammar.production import Grammar
from cutgrammar.inference.attributes import Attributes

MIN_WEIGHT = 1e-12
"""Minimum weight of a type as a terminal, so that every parse tree remains possible."""


@dataclass(frozen=True, eq=False)
class Problem:
    """The inference problem of Eq. (8).

    Attributes:
        grammar: the grammar G.
        log_current: (m, k) log p(c|z) of the current fragments.
        log_goal: (g, k) log p(z|c) of the goal's fragments up to a constant (see `shape_likelihood`).
        p_WG: (g, 3) centroids of the goal's fragments in the world frame W [m].
        layout_length_scale: distance at which a fragment becomes e times less likely in Eq. (7) [m].
        attributes: what `grammar-plus` adds; None for the paper's Eq. (3).

    Raises:
        ValueError: arrays do not match each other or the grammar, a number is not finite, or there are no fragments.
    """

    grammar: Grammar
    log_current: Floats
    log_goal: Floats
    p_WG: Floats
    layout_length_scale: float
    attributes: Attributes | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "log_current", frozen_floats(self.log_current, (None, self.grammar.k), "log_current"))
        object.__setattr__(self, "log_goal", frozen_floats(self.log_goal, (None, self.grammar.k), "log_goal"))
        object.__setattr__(self, "p_WG", frozen_floats(self.p_WG, (len(self.log_goal), 3), "p_WG"))
        if not len(self.log_current) or not len(self.log_goal):
            raise ValueError("a search needs current fragments and goal fragments")
        if not (np.isfinite(self.layout_length_scale) and self.layout_length_scale > 0.0):
            raise ValueError(f"layout_length_scale is {self.layout_length_scale} m; a positive length was expected")
        if self.attributes is not None:
            sizes = tuple(map(len, (self.attributes.goal_volumes, self.attributes.current_volumes)))
            if (
                sizes != (len(self.log_goal), len(self.log_current))
                or len(self.attributes.log_volume) != self.grammar.k
            ):
                raise ValueError("the attributes are not those of these fragments and types")

    def __reduce__(self) -> tuple[Any, ...]:
        scale, attributes = self.layout_length_scale, self.attributes
        return Problem, (self.grammar, self.log_current, self.log_goal, self.p_WG, scale, attributes)


def shape_likelihood(log_types: Floats, grammar: Grammar, divide_by_type_prior: bool) -> Floats:
    """Log p(z|c) of fragments up to log p(z), the factors of Eq. (5).

    By Bayes' rule p(z|c) = p(c|z) p(z) / p(c). The paper omits p(c), which penalises rare types; p(z) is equal for all
    parse trees and omitted.

    Args:
        log_types: (n, k) log p(c|z).
        grammar: provides p(c), the share of each type among the training fragments.
        divide_by_type_prior: True: p(c|z) / p(c); False: p(c|z), as printed.

    Raises:
        ValueError: a type has no training fragments, so p(c) is zero.
    """
    if not divide_by_type_prior:
        return log_types
    shares = np.array(grammar.frequencies)
    if shares.min() <= 0.0:
        raise ValueError(f"type c{int(shares.argmin())} has frequency 0; every type needs a training fragment")
    return np.asarray(log_types - np.log(shares))


def terminal_weights(log_goal: Floats) -> Floats:
    """(k,) weight of each type as a terminal, at most 1: the mean over the goal's fragments of p(z|c) / max p(z|c).

    Args:
        log_goal: (g, k) log p(z|c) of the goal's fragments, each row up to a constant.
    """
    weights = np.exp(log_goal - log_goal.max(axis=1, keepdims=True)).mean(axis=0)
    return np.asarray(np.maximum(weights / weights.max(), MIN_WEIGHT))
