"""One demonstration (IV-A): the fragments, their poses after every step, and the cuts."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from cutgrammar.geometry.arrays import Floats, frozen_floats
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


PERSON, ROBOT = "person", "test-robot"
"""Who made a demonstration by hand, as `Demonstration.demonstrator` begins; the participant's code follows."""


@dataclass(frozen=True, eq=False)
class HandStroke:
    """How a cut was made by hand, with two clicks on a view of the fragments.

    Attributes:
        step: of the cut.
        p_WE: (3,) the eye of the view in the world frame W [m].
        first_W, second_W: (3,) unit directions from the eye through the two clicks.
        explode: how far apart the fragments were shown, from 0 (in place) to 1.
        first_seconds, second_seconds, cut_seconds: time of both clicks, and of the decision to cut, since the task was
            shown first [s].
        undone_seconds: time at which the cut was undone; None if it was kept [s].
    """

    step: int
    p_WE: Floats
    first_W: Floats
    second_W: Floats
    explode: float
    first_seconds: float
    second_seconds: float
    cut_seconds: float
    undone_seconds: float | None = None

    def __post_init__(self) -> None:
        for name in ("p_WE", "first_W", "second_W"):
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (3,), name))


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One trial of the data set: how an initial configuration was cut into a goal configuration.

    Attributes:
        trial: number within the data set.
        setup: name of the setup, e.g. "N2M1".
        foods: name of the food of every initial object.
        categories: the categories in the goal, in the order of `CATEGORIES`.
        demonstrator: "scripted", or `PERSON` or `ROBOT` with the participant's code, e.g. "person P07".
        seed: seed of the data set that it was made for.
        fragments: all objects and fragments of all steps, by id.
        poses: (step, fragment id) -> X_WF at rest after that step, for every fragment that exists then.
        cuts: in the order in which they were made.
        strokes: how the cuts were made by hand, in their order; empty for a scripted demonstration.
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
    strokes: tuple[HandStroke, ...] = ()

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


@dataclass(frozen=True, eq=False)
class DemonstratedObject:
    """One initial object of a demonstration with all that it was cut into.

    Attributes:
        demonstration: the demonstration.
        number: number of the object within it, which is the id of its first fragment.
    """

    demonstration: Demonstration
    number: int

    @property
    def trial(self) -> int:
        """The number of its trial."""
        return self.demonstration.trial

    @property
    def food(self) -> str:
        """The name of its food."""
        return self.demonstration.foods[self.number]

    @property
    def whole(self) -> Fragment:
        """The object before the first cut."""
        return self.demonstration.fragment_at(0, self.number)

    @property
    def goal(self) -> Configuration:
        """What it was cut into, by ascending id, at rest after the last step."""
        last = self.demonstration.steps
        return tuple(self.demonstration.fragment_at(last, i) for i in self._final)

    @property
    def categories(self) -> frozenset[str]:
        """The categories that it was cut into; those of the whole trial if its fragments do not tell."""
        found = [self.demonstration.fragments[i].category for i in self._final]
        return frozenset(name for name in found if name) if all(found) else frozenset(self.demonstration.categories)

    @property
    def cuts(self) -> tuple[DemonstratedCut, ...]:
        """The cuts of this object and its fragments that were not undone, in their order."""
        return tuple(cut for cut in self.demonstration.cuts if cut.fragment in self._descendants and not cut.undone)

    @property
    def _final(self) -> tuple[int, ...]:
        return tuple(i for i in self.demonstration.alive(self.demonstration.steps) if i in self._descendants)

    @cached_property
    def _descendants(self) -> frozenset[int]:
        """The ids of the object and of all fragments that were cut from it; a parent comes before its products."""
        found = {self.number}
        for fragment in self.demonstration.fragments:
            if fragment.parent in found:
                found.add(fragment.id)
        return frozenset(found)


def objects_of(demonstration: Demonstration) -> tuple[DemonstratedObject, ...]:
    """The initial objects of a demonstration, in their order."""
    return tuple(DemonstratedObject(demonstration, number) for number in range(len(demonstration.foods)))
