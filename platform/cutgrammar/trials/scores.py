"""Scores, each of which is one entry point of the group "cutgrammar.scores".

Records, tables, JSON, MLflow, pages and help texts are generated from these entries.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cutgrammar.geometry.fragment import Configuration
from cutgrammar.plugins import SCORES, Registry, names_in, reference_of

if TYPE_CHECKING:  # exact booleans take a second to import, and reports do without them
    from cutgrammar.geometry.comparison.overlap import Matching, Solid


RESERVED = ("cuts", "seconds")
"""Names that are no scores, but have a mean in reports."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A configuration reached beside its goal, with the fragments matched: what a score is computed from.

    Attributes:
        reached, goal: the two configurations, in the world frame; all shapes are meshes.
        reached_solids, goal_solids: their fragments in canonical frames, in the same order.
        matching: the assignment with the greatest sum of IoU.
    """

    reached: Configuration
    goal: Configuration
    reached_solids: "tuple[Solid, ...]"
    goal_solids: "tuple[Solid, ...]"
    matching: "Matching"

    @property
    def pairs(self) -> "list[tuple[Solid, Solid, float]]":
        """The matched (reached, goal) solids, each with its IoU."""
        m = self.matching
        rows = zip(m.reached.tolist(), m.goal.tolist(), m.ious.tolist(), strict=True)
        return [(self.reached_solids[i], self.goal_solids[j], iou) for i, j, iou in rows]

    def mean(self, values: Iterable[float], unmatched: float = 0.0) -> float:
        """The sum of one value a pair, divided by the larger number of fragments, so that stopping early cannot win.

        Args:
            values: one for each of `pairs`.
            unmatched: the value of each fragment without a counterpart.
        """
        larger = self.matching.larger
        return (sum(values) + unmatched * (larger - len(self.matching.reached))) / larger


@dataclass(frozen=True)
class Score:
    """One score: how it is called, read and computed.

    Attributes:
        name: that of its entry point and in records; reports call its mean NAME_mean.
        label: heading in tables.
        help: one sentence for readers of a report.
        compute: the score of a trial, or None where it is not known; None for one that people give later.
        worst: the value of a trial whose configuration is unknown; None leaves such a trial out of the mean.
        higher_is_better: the direction.
        position: its place in tables; scores with equal positions follow by name.
    """

    name: str
    label: str
    help: str
    compute: Callable[[Comparison], float | None] | None
    worst: float | None = 0.0
    higher_is_better: bool = True
    position: int = 100

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.name in RESERVED:
            raise ValueError(f"{self.name!r} cannot name a score; it must be an identifier other than {RESERVED}")

    @property
    def table_order(self) -> tuple[int, str]:
        """Key to sort scores by in tables: by position, then by name."""
        return self.position, self.name


def computed_scores() -> dict[str, str]:
    """Name -> "module:attribute" of the scores that are computed from configurations, in the order of tables."""
    return {score.name: reference_of(SCORES, score.name) for score in installed_scores() if score.compute is not None}


def installed_scores() -> tuple[Score, ...]:
    """All installed scores, in the order of tables.

    Raises:
        InputError: one of them cannot be loaded, or its name is not that of its entry point.
    """
    return tuple(sorted(map(_REGISTRY.find, names_in(SCORES)), key=lambda score: score.table_order))


def describe_scores(names: Iterable[str]) -> tuple[Score, ...]:
    """All installed scores and those called `names`, in the order of tables; of one not installed the name is known."""
    return _REGISTRY.describe((*names_in(SCORES), *names))


_REGISTRY = Registry(SCORES, Score, lambda name, reason: Score(name, name, f"{reason[:1].upper()}{reason[1:]}.", None))
load_score = _REGISTRY.load
