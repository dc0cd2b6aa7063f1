"""What a person is asked to do."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from cutgrammar.demonstration import DemonstratedObject, Demonstration, objects_of
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar_dashboards.rendering.food_colours import largest_facet


@dataclass(frozen=True, eq=False)
class Task:
    """One trial to be demonstrated by hand.

    Attributes:
        trial: its number in the data set.
        setup: name of the setup.
        categories: the categories of the goal.
        foods: name of every object's food.
        jobs: the categories of every object; several are for equal lengths of it, from -x to +x of its frame F.
        start: the objects.
        seed: of the data set.
        goal: (number of the object, fragment) of a goal that is to be reproduced; None where categories say what to do.
    """

    trial: int
    setup: str
    categories: tuple[str, ...]
    foods: tuple[str, ...]
    jobs: tuple[tuple[str, ...], ...]
    start: Configuration
    seed: int
    goal: tuple[tuple[int, Fragment], ...] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the objects: their foods, numbered where two are alike."""
        return tuple(f"{food} {i + 1}" if self.foods.count(food) > 1 else food for i, food in enumerate(self.foods))

    @cached_property
    def flat(self) -> tuple[float, ...]:
        """The largest flat part of every object's skin [m2]; larger ones come from cuts."""
        return tuple(largest_facet((whole,)) for whole in self.start)

    @property
    def instructions(self) -> tuple[str, ...]:
        """What to do with every object, in plain words."""
        if self.goal is not None:
            return (f"Cut {_list(self.names)} into the fragments of the goal, {len(self.goal)} in all.",)
        return tuple(_instruction(name, job) for name, job in zip(self.names, self.jobs, strict=True))

    def category_at(self, number: int, x: float) -> str:
        """The category of a fragment of object `number` whose centroid is at `x` in F [m], by the parts of its job."""
        job = self.jobs[number]
        vertices = self.start[number].mesh.vertices[:, 0]
        share = (x - float(vertices.min())) / float(vertices.max() - vertices.min())
        return job[min(max(int(share * len(job)), 0), len(job) - 1)]


def task_of(demonstration: Demonstration) -> Task:
    """The task to reproduce the goal of a demonstration from its start."""
    objects = objects_of(demonstration)
    last = demonstration.steps
    goal = tuple(
        (one.number, demonstration.fragment_at(last, i))
        for one in objects
        for i in demonstration.alive(last)
        if _root(demonstration, i) == one.number
    )
    return Task(
        demonstration.trial,
        demonstration.setup,
        demonstration.categories,
        demonstration.foods,
        tuple(_along(demonstration, one) for one in objects),
        demonstration.start,
        demonstration.seed,
        goal,
    )


def _along(demonstration: Demonstration, one: DemonstratedObject) -> tuple[str, ...]:
    """The categories that an object was cut into, by where their fragments lie along x of its frame F."""
    places: dict[str, list[float]] = {name: [] for name in sorted(one.categories)}
    for fragment in demonstration.fragments:
        if fragment.category in places and _root(demonstration, fragment.id) == one.number:
            places[fragment.category].append(float(fragment.mesh.centroid[0]))
    return tuple(sorted(places, key=lambda name: sum(places[name]) / max(len(places[name]), 1)))


def _root(demonstration: Demonstration, fragment: int) -> int:
    parent = demonstration.fragments[fragment].parent
    return fragment if parent is None else _root(demonstration, parent)


def _list(names: Sequence[str]) -> str:
    """Names as a list in words, with articles."""
    words = [name if name[-1].isdigit() else f"the {name}" for name in names]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _instruction(name: str, job: tuple[str, ...]) -> str:
    article = "" if name[-1].isdigit() else "the "
    if len(job) == 1:
        return f"Cut {article}{name} into {job[0]}."
    places = {2: ("left half", "right half"), 3: ("left third", "middle", "right third")}.get(
        len(job), tuple(f"part {i + 1} of {len(job)} from the left" for i in range(len(job)))
    )
    parts = [f"the {place} into {category}" for place, category in zip(places, job, strict=True)]
    return f"Cut {article}{name}: {', '.join(parts[:-1])} and {parts[-1]}."
