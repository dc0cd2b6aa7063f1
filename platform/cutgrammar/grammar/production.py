"""Productions and the grammar G = <V_NT, V_T, v_S, R, P> (II-A).

Every fragment type is a variable: a non-terminal if a parse tree expands it, otherwise a terminal. The start symbol v_S
produces the current fragments; its productions are not learned but follow from perception.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any


@dataclass(frozen=True, order=True)
class Production:
    """A fragment type is divided into others: parent -> children, with the children sorted."""

    parent: int
    children: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.children) < 2:
            raise ValueError(f"a production has at least two children, not {len(self.children)}")
        object.__setattr__(self, "children", tuple(sorted(self.children)))

    def __str__(self) -> str:
        return f"c{self.parent} -> " + " ".join(f"c{child}" for child in self.children)


@dataclass(frozen=True)
class Grammar:
    """Fragment types 0 to k - 1 and the branching probabilities of their productions (Eq. 2).

    Attributes:
        k: number of fragment types.
        probabilities: branching probability of every production; those of one parent sum to 1.
        frequencies: (k,) share of each type among the training fragments, p(c) of Eq. (5).
    """

    k: int
    probabilities: Mapping[Production, float]
    frequencies: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.frequencies) != self.k:
            raise ValueError(f"{len(self.frequencies)} type frequencies for {self.k} types")
        for production in self.probabilities:
            if not all(0 <= c < self.k for c in (production.parent, *production.children)):
                raise ValueError(f"production {production} names a type outside 0 to {self.k - 1}")
        for parent, options in self.options.items():
            total = sum(self.probabilities[option] for option in options)
            if abs(total - 1.0) > 1e-9:
                raise ValueError(f"the productions of c{parent} have probabilities that sum to {total:.6g}, not 1")

    @cached_property
    def options(self) -> dict[int, tuple[Production, ...]]:
        """The productions of every type that has any, sorted."""
        found: dict[int, list[Production]] = {}
        for production in sorted(self.probabilities):
            found.setdefault(production.parent, []).append(production)
        return {parent: tuple(options) for parent, options in found.items()}

    def to_json(self) -> dict[str, Any]:
        """The grammar as plain data for JSON."""
        return {
            "k": self.k,
            "frequencies": list(self.frequencies),
            "productions": [
                {"parent": p.parent, "children": list(p.children), "probability": self.probabilities[p]}
                for p in sorted(self.probabilities)
            ],
        }

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> "Grammar":
        """The inverse of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: `data` does not describe a grammar.
        """
        return Grammar(
            k=int(data["k"]),
            probabilities={
                Production(int(row["parent"]), tuple(int(c) for c in row["children"])): float(row["probability"])
                for row in data["productions"]
            },
            frequencies=tuple(float(f) for f in data["frequencies"]),
        )
