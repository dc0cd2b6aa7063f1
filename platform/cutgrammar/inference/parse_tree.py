"""Parse trees (II-A) as arrays in canonical order, and partial parse trees that are still being expanded.

v_S produces the current fragments; every other node is expanded by a production or stays a terminal. The nodes of a
tree are listed in preorder (depth first, left to right) and decided in that order: the leftmost open leaf becomes a
terminal or takes one of the productions of its type. Every ordered tree is therefore built in exactly one way; if
leaves were expanded in any order, there would be factorially many.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Ints, frozen_ints

TERMINAL = -1
"""The decision that a node is a terminal; it takes the place of a production's number."""
START = -1
"""The parent of the current fragments: the start symbol v_S, which has no entry in the arrays."""


@dataclass(frozen=True, eq=False)
class ParseTree:
    """A complete parse tree below v_S, in preorder.

    Attributes:
        types: (n,) fragment type of every node.
        parents: (n,) index of each node's parent; `START` for the current fragments, which keep their order.
        productions: (n,) number of the production that expands the node, or `TERMINAL`.

    Raises:
        ValueError: the arrays differ in length, or the nodes are not in preorder.
    """

    types: Ints
    parents: Ints
    productions: Ints

    def __post_init__(self) -> None:
        for name in ("types", "parents", "productions"):
            object.__setattr__(self, name, frozen_ints(getattr(self, name), (len(self.types),), name))
        if np.any(self.parents >= np.arange(len(self.parents))) or np.any(self.parents < START):
            raise ValueError("the nodes of a parse tree must be in preorder, parents before children")

    def __reduce__(self) -> tuple[Any, ...]:
        return ParseTree, (self.types, self.parents, self.productions)

    @property
    def terminals(self) -> Ints:
        """(t,) the nodes that are not expanded, ascending."""
        return np.flatnonzero(self.productions == TERMINAL)

    @property
    def roots(self) -> Ints:
        """(m,) the nodes of the current fragments, in order."""
        return np.flatnonzero(self.parents == START)

    def children(self, node: int) -> Ints:
        """The children of `node`, ascending."""
        return np.flatnonzero(self.parents == node)


@dataclass
class PartialParseTree:
    """A parse tree under construction: the nodes decided so far, in preorder, and the open leaves.

    Attributes:
        types, parents, productions: the decided nodes, as in `ParseTree`.
        open: (type, parent) of every open leaf; the leftmost is last.
        remaining: number of terminals that the open leaves must still produce.
    """

    types: list[int] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    productions: list[int] = field(default_factory=list)
    open: list[tuple[int, int]] = field(default_factory=list)
    remaining: int = 0

    @staticmethod
    def of(types: tuple[int, ...], terminals: int) -> "PartialParseTree":
        """A tree with current fragments of these types and no decisions, to be completed to `terminals` terminals."""
        return PartialParseTree(open=[(c, START) for c in reversed(types)], remaining=terminals)

    def decide(self, production: int, children: tuple[int, ...]) -> None:
        """Decide the leftmost open leaf: `TERMINAL` without children, or a production with its children's types."""
        c, parent = self.open.pop()
        node = len(self.types)
        self.types.append(c)
        self.parents.append(parent)
        self.productions.append(production)
        if production == TERMINAL:
            self.remaining -= 1
        else:
            self.open.extend((child, node) for child in reversed(children))
