"""Parse trees (II-A) as arrays in their canonical order, and the state of one that is not finished.

v_S produces the current fragments; every other node is expanded by a production or stays a terminal. A tree is
written down depth first, left to right, and it is grown in that order: the leftmost open leaf is decided next, either
to stay a terminal or to take one of the productions of its type. So each (ordered) tree is reached in one way only,
where growing the leaves in any order would reach it in factorially many.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Ints

TERMINAL = -1
"""The decision to expand no further, where a production's number would stand."""
START = -1
"""The parent of the current fragments: the start symbol v_S, which is no entry of the arrays."""


@dataclass(frozen=True, eq=False)
class ParseTree:
    """A finished parse tree below v_S, in preorder.

    Attributes:
        types: (n,) fragment type of every node.
        parents: (n,) index of each node's parent, `START` for the current fragments, which come in their order.
        productions: (n,) number of the production that expands the node, `TERMINAL` for none.

    Raises:
        ValueError: arrays of different length, or nodes that are not in preorder.
    """

    types: Ints
    parents: Ints
    productions: Ints

    def __post_init__(self) -> None:
        for name in ("types", "parents", "productions"):
            array = np.array(getattr(self, name), dtype=np.int64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not len(self.types) == len(self.parents) == len(self.productions):
            raise ValueError(
                f"{len(self.types)} types, {len(self.parents)} parents and {len(self.productions)} productions "
                "do not describe one tree"
            )
        if np.any(self.parents >= np.arange(len(self.parents))) or np.any(self.parents < START):
            raise ValueError("the nodes of a parse tree come in preorder, parents before children")

    def __reduce__(self) -> tuple[Any, ...]:
        return ParseTree, (self.types, self.parents, self.productions)

    @property
    def terminals(self) -> Ints:
        """(t,) the nodes that are not expanded, ascending."""
        return np.flatnonzero(self.productions == TERMINAL)

    @property
    def roots(self) -> Ints:
        """(m,) the nodes of the current fragments, in their order."""
        return np.flatnonzero(self.parents == START)

    def children(self, node: int) -> Ints:
        """The nodes that `node` produces, ascending."""
        return np.flatnonzero(self.parents == node)


@dataclass
class PartialParseTree:
    """A parse tree that is being grown: what is decided so far, in preorder, and the leaves that are open.

    Attributes:
        types, parents, productions: as in `ParseTree`, of the nodes decided.
        open: (type, parent) of the open leaves, the leftmost last.
        left: number of terminals that the open leaves must still yield.
    """

    types: list[int] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    productions: list[int] = field(default_factory=list)
    open: list[tuple[int, int]] = field(default_factory=list)
    left: int = 0

    @staticmethod
    def of(types: tuple[int, ...], terminals: int) -> "PartialParseTree":
        """Current fragments of these types, nothing decided, to become `terminals` terminals."""
        return PartialParseTree(open=[(c, START) for c in reversed(types)], left=terminals)

    def decide(self, production: int, children: tuple[int, ...]) -> None:
        """Decide the leftmost open leaf: `TERMINAL` without children, or a production with its children's types."""
        c, parent = self.open.pop()
        node = len(self.types)
        self.types.append(c)
        self.parents.append(parent)
        self.productions.append(production)
        if production == TERMINAL:
            self.left -= 1
        else:
            self.open.extend((child, node) for child in reversed(children))
