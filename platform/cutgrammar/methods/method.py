"""What a method declares about itself, and what its planners are made from.

An entry point of the group "cutgrammar.methods" yields a `Method`. Tables, help texts and the decision which goals a
method is tried on, and whether it is given the demonstration, all follow from this one entry.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

from cutgrammar.demonstration import DemonstratedObject, Demonstration
from cutgrammar.interfaces import ParallelMap, Planner, run_serially
from cutgrammar.settings import Settings

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model

Kind = Literal["method", "baseline", "control", "person", "demonstration", "oracle", "unknown"]
"""The role of a method in a comparison, in the order of tables.

A "method" plans from what it has learned, a "baseline" is what it is compared with, and a "control" learns nothing. A
"person" repeats what people cut who were shown the goal, a "demonstration" cuts as the demonstrator would, and an
"oracle" is given part of the answer. A method that is not installed is "unknown".
"""


@dataclass(frozen=True, eq=False)
class PlanningContext:
    """What a planner may be made from.

    Attributes:
        model: what was learned from the training trials.
        settings: all settings.
        demonstration: the trial's own demonstration; None for a method that does not declare `sees_demonstration`.
        parallel_map: carries out independent searches; where each runs changes no result.
        donors: under foreign goals, the demonstrated objects that the goal's fragments were cut from, one for each
            initial object of the trial, in their order; withheld like the demonstration.
        reproduction: how a person reproduced the trial's goal; None for a method of another kind than "person".
    """

    model: "Model"
    settings: Settings
    demonstration: Demonstration | None = None
    parallel_map: ParallelMap = run_serially
    donors: tuple[DemonstratedObject, ...] = ()
    reproduction: Demonstration | None = None

    def require_demonstration(self) -> Demonstration:
        """The demonstration, for a method that cannot do without it.

        Raises:
            ValueError: there is none.
        """
        if self.demonstration is None:
            raise ValueError("the planner needs a demonstration and was given none; declare sees_demonstration=True")
        return self.demonstration

    def require_reproduction(self) -> Demonstration:
        """How a person reproduced the goal, for a method that repeats it.

        Raises:
            ValueError: there is no such reproduction.
        """
        if self.reproduction is None:
            raise ValueError("the planner repeats what a person cut and was given nothing; only evaluate --human does")
        return self.reproduction


@dataclass(frozen=True)
class Method:
    """One method: its name, what tables and help say about it, and how its planners are made.

    Attributes:
        name: that of its entry point.
        make_planner: makes a fresh planner for one trial.
        description: one line for help and tables.
        kind: its role in a comparison.
        sees_demonstration: it is given the trial's own demonstration, and under foreign goals the goal's, so tables
            mark it and do not rank it.
        goals: the goal conditions that it applies to; None for all.
        position: its place among methods of its kind in tables; those with equal positions follow by name.
        is_deterministic: neither the model nor the seed of planning changes its cuts, so that in a world without chance
            one run of a trial stands for all.
    """

    name: str
    make_planner: Callable[[PlanningContext], Planner]
    description: str = ""
    kind: Kind = "method"
    sees_demonstration: bool = False
    goals: tuple[str, ...] | None = None
    position: int = 100
    is_deterministic: bool = False

    @property
    def is_competitor(self) -> bool:
        """Whether it may be ranked: it is known to plan from the goal alone."""
        return not self.sees_demonstration and self.kind in ("method", "baseline", "control")

    @property
    def is_person(self) -> bool:
        """Whether people made its cuts."""
        return self.kind == "person"

    @property
    def table_order(self) -> tuple[bool, int, int, str]:
        """Key to sort methods by in tables: those that see the demonstration last, then by kind, position and name."""
        return self.sees_demonstration, get_args(Kind).index(self.kind), self.position, self.name

    def applies_to(self, goals: str) -> bool:
        """Whether the method can be tried under the goal condition `goals`."""
        return self.goals is None or goals in self.goals

    def planner(self, context: PlanningContext) -> Planner:
        """A fresh planner for one trial; what the method does not declare to see is withheld."""
        if not self.sees_demonstration:
            context = replace(context, demonstration=None, donors=())
        if not self.is_person:
            context = replace(context, reproduction=None)
        return self.make_planner(context)
