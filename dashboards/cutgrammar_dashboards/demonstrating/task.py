"""What a person is asked to do."""

from dataclasses import dataclass

from cutgrammar.geometry.fragment import Configuration


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
    """

    trial: int
    setup: str
    categories: tuple[str, ...]
    foods: tuple[str, ...]
    jobs: tuple[tuple[str, ...], ...]
    start: Configuration
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the objects: their foods, numbered where two are alike."""
        return tuple(f"{food} {i + 1}" if self.foods.count(food) > 1 else food for i, food in enumerate(self.foods))

    @property
    def instructions(self) -> tuple[str, ...]:
        """What to do with every object, in plain words."""
        return tuple(_instruction(name, job) for name, job in zip(self.names, self.jobs, strict=True))

    def category_at(self, number: int, x: float) -> str:
        """The category of a fragment of object `number` whose centroid is at `x` in F [m], by the parts of its job."""
        job = self.jobs[number]
        vertices = self.start[number].mesh.vertices[:, 0]
        share = (x - float(vertices.min())) / float(vertices.max() - vertices.min())
        return job[min(max(int(share * len(job)), 0), len(job) - 1)]


def _instruction(name: str, job: tuple[str, ...]) -> str:
    article = "" if name[-1].isdigit() else "the "
    if len(job) == 1:
        return f"Cut {article}{name} into {job[0]}."
    places = {2: ("left half", "right half"), 3: ("left third", "middle", "right third")}.get(
        len(job), tuple(f"part {i + 1} of {len(job)} from the left" for i in range(len(job)))
    )
    parts = [f"the {place} into {category}" for place, category in zip(places, job, strict=True)]
    return f"Cut {article}{name}: {', '.join(parts[:-1])} and {parts[-1]}."
