"""The reproductions of goals by people, as an evaluation takes them from what `cutgrammar record --reproduce` kept.

Every data set holds a goal at most once. Of several data sets, each reproduction of a goal is a trial of its own, with
the position of its data set among those that have the goal as the number of its run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cutgrammar.demonstration import PERSON, ROBOT, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.manifest import reproduction_of
from cutgrammar.storage.shared_storage import absolute, local_folder
from cutgrammar_pipelines.stages.progress import note


@dataclass(frozen=True, eq=False)
class People:
    """Who reproduced which goals.

    Attributes:
        sets: the data sets of reproductions.
        found_at: absolute path or URL of each.
        places: trial -> for each of its reproductions, the number of its data set.
        by_robot: whether reproductions that a test robot made are among them.
    """

    sets: tuple[DataSet, ...]
    found_at: tuple[str, ...]
    places: Mapping[int, tuple[int, ...]]
    by_robot: bool

    def reproductions(self, trial: int) -> range:
        """The numbers of a goal's reproductions."""
        return range(len(self.places.get(trial, ())))

    def reproduction(self, trial: int, number: int) -> Demonstration:
        """One reproduction of a goal."""
        return self.sets[self.places[trial][number]].demonstration(trial)


NOBODY = People((), (), {}, False)


def open_people(given: Sequence[str | Path], goals: DataSet, goals_at: str | Path, test_robots: bool = False) -> People:
    """Open data sets of reproductions.

    Args:
        given: folders that `record --reproduce` made, or their URLs.
        goals: the data set whose goals were reproduced.
        goals_at: its folder or URL.
        test_robots: also take reproductions that a test robot made. They are otherwise left out with a note.

    Raises:
        InputError: a folder is no data set, has reproductions of other goals, is given twice, or none is left.
    """
    if not given:
        return NOBODY
    sets = tuple(DataSet.open(local_folder(place)) for place in given)
    places: dict[int, tuple[int, ...]] = {}
    robots: list[int] = []
    for number, (place, made) in enumerate(zip(given, sets, strict=True)):
        if made.definition != reproduction_of(goals.digest):
            raise InputError(
                f"{place} does not hold reproductions of the goals of {goals_at}; people make them with: "
                f"cutgrammar record --reproduce {goals_at} --out FOLDER"
            )
        if made.digest in {other.digest for other in sets[:number]}:
            raise InputError(f"{place} is given twice; give every data set once")
        for one in made.trials:
            kind = one.demonstrator.partition(" ")[0]
            robots += [one.trial] * (kind == ROBOT)
            if kind == PERSON or (kind == ROBOT and test_robots):
                places[one.trial] = (*places.get(one.trial, ()), number)
    if robots and not test_robots:
        note(f"NOTE {len(robots)} reproductions were made by a test robot and are left out")
    if not places:
        raise InputError(
            f"no person made a reproduction in {', '.join(map(str, given))}; a test robot's are never evaluated"
        )
    return People(sets, tuple(map(absolute, given)), places, bool(robots) and test_robots)
