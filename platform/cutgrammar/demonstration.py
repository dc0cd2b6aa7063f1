"""One demonstration (IV-A): the fragments, their poses after every step, and the cuts."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose

CATEGORIES = ("chunks", "slices", "cubes", "strips")
"""The fragment categories of IV-A."""


@dataclass(frozen=True, eq=False)
class DemonstratedFragment:
    """An initial object or a fragment that exists at some step of a demonstration.

    Attributes:
        id: number within the demonstration; the initial objects come first.
        parent: id of the fragment that it was cut from; None for an initial object.
        step: number of the cut that produced it; 0 for an initial object.
        category: its category in the goal; None if it is not part of the goal.
        mesh: closed mesh in the fragment's frame F.
    """

    id: int
    parent: int | None
    step: int
    category: str | None
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class DemonstratedCut:
    """A cut of one fragment.

    Attributes:
        step: 1 for the first cut.
        plane_W: cutting plane in the world frame.
        plane_C: the same plane in the canonical frame of the fragment (III).
        fragment: id of the fragment cut.
        products: ids of the fragments that it was divided into.
        undone: whether the demonstrator undid the cut; such a cut is kept but ignored.
    """

    step: int
    plane_W: Plane
    plane_C: Plane
    fragment: int
    products: tuple[int, ...]
    undone: bool = False


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One trial of the data set: how an initial configuration was cut into a goal configuration.

    Attributes:
        trial: number within the data set.
        setup: name of the setup, e.g. "N2M1".
        foods: name of the food of every initial object.
        categories: the categories in the goal, in the order of `CATEGORIES`.
        demonstrator: name of the demonstrator, e.g. "scripted".
        seed: seed of the data set that it was made for.
        fragments: all objects and fragments of all steps, by id.
        poses: (step, fragment id) -> X_WF at rest after that step, for every fragment that exists then.
        cuts: in the order in which they were made.
    """

    trial: int
    setup: str
    foods: tuple[str, ...]
    categories: tuple[str, ...]
    demonstrator: str
    seed: int
    fragments: tuple[DemonstratedFragment, ...]
    poses: Mapping[tuple[int, int], Pose]
    cuts: tuple[DemonstratedCut, ...]

    @property
    def steps(self) -> int:
        """Number of the last step."""
        return max(step for step, _ in self.poses)

    def alive(self, step: int) -> tuple[int, ...]:
        """The ids of the fragments that exist after `step`, ascending."""
        return tuple(sorted(fragment for other, fragment in self.poses if other == step))

    def fragment_at(self, step: int, fragment: int) -> Fragment:
        """The fragment with id `fragment` at its pose after `step`."""
        return Fragment(self.fragments[fragment].mesh, self.poses[step, fragment])

    def configuration(self, step: int) -> Configuration:
        """All fragments at their poses after `step`, by ascending id."""
        return tuple(self.fragment_at(step, fragment) for fragment in self.alive(step))

    @cached_property
    def start(self) -> Configuration:
        """The initial configuration."""
        return self.configuration(0)

    @cached_property
    def goal(self) -> Configuration:
        """The final configuration by ascending id; `trials.goals` removes what a planner must not see."""
        return self.configuration(self.steps)
