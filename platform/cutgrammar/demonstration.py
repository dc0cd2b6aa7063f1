"""One demonstration (IV-A): the fragments, their poses after every step, and the cuts that made them."""

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
    """An object or fragment that existed at some time of a demonstration.

    Attributes:
        id: number within the demonstration; the initial objects come first.
        parent: id of the fragment it was cut from, None for an initial object.
        step: number of cuts made when it appeared, 0 for an initial object.
        category: what it belongs to in the goal, None while it is to be cut further.
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
        products: ids of what it became.
        undone: the demonstrator took it back; it is kept for the record and counts for nothing.
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
        demonstrator: who cut, e.g. "scripted".
        seed: of the data set it was made for.
        fragments: all that ever existed, by id.
        poses: (step, fragment id) -> X_WF after that step has settled, for every fragment alive then.
        cuts: in the order they were made.
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
        """Ids of the fragments that exist after `step`, ascending."""
        return tuple(sorted(fragment for at, fragment in self.poses if at == step))

    def fragment_at(self, step: int, fragment: int) -> Fragment:
        """Fragment `fragment` as it lay after `step`."""
        return Fragment(self.fragments[fragment].mesh, self.poses[step, fragment])

    def configuration(self, step: int) -> Configuration:
        """All fragments as they lay after `step`, by ascending id."""
        return tuple(self.fragment_at(step, fragment) for fragment in self.alive(step))

    @cached_property
    def start(self) -> Configuration:
        """The initial configuration."""
        return self.configuration(0)

    @cached_property
    def goal(self) -> Configuration:
        """The final configuration, with ids and order; `trials.goals` strips what a planner must not see."""
        return self.configuration(self.steps)
