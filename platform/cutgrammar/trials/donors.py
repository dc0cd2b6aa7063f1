"""Donors of foreign goals: for each object of a trial, another individual whose fragments become its goal.

Nobody has scans of the fragments of an object that is still whole. Under a foreign goal a planner is therefore given
what another individual was cut into (`trials.goals` scales and places it). The donor of an object is an object of
another trial with the same categories of fragments:

- `foreign`: of the same food where there is such a donor, otherwise of another food;
- `foreign-food`: of another food only.

It is drawn uniformly from a stream of the trial, so that all methods and runs of a trial meet the same donors. Donors
are test trials; only where no test trial has one, trials that are in neither part of the split are drawn from. A
training trial is never a donor. Two objects of a trial have different donors where there are enough.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cutgrammar import seeds
from cutgrammar.demonstration import DemonstratedObject, Demonstration, objects_of
from cutgrammar.errors import InputError
from cutgrammar.trials.goals import OTHER_FOOD


@dataclass(frozen=True)
class ObjectFacts:
    """What decides whether an object can be the donor of another.

    Attributes:
        trial: number of its trial.
        number: number of the object within the trial.
        food: name of its food.
        categories: the categories that it was cut into.
    """

    trial: int
    number: int
    food: str
    categories: frozenset[str]


def object_facts(demonstration: Demonstration) -> tuple[ObjectFacts, ...]:
    """The facts of the objects of a demonstration, in their order."""
    return tuple(ObjectFacts(o.trial, o.number, o.food, o.categories) for o in objects_of(demonstration))


class DonorPool:
    """Finds the donors of trials; every demonstration is read once, when the first trial asks, and not kept.

    Args:
        read: trial -> its demonstration.
        test: numbers of the test trials.
        spare: numbers of the trials that are in neither part of the split.
        seed: of the evaluation.
    """

    def __init__(
        self, read: Callable[[int], Demonstration], test: Iterable[int], spare: Iterable[int], seed: int
    ) -> None:
        self._read = read
        self._numbers = (tuple(sorted(test)), tuple(sorted(spare)))
        self._seed = seed
        self._facts: dict[int, tuple[ObjectFacts, ...]] = {}
        self._alike: dict[int, dict[frozenset[str], list[ObjectFacts]]] = {}

    def choose(self, setup: str, trial: int, condition: str) -> tuple[ObjectFacts, ...]:
        """The donor of every object of a trial.

        Args:
            setup: name of the trial's setup.
            trial: its number.
            condition: one of `goals.FOREIGN`.

        Raises:
            InputError: an object has no donor.
        """
        rng = seeds.stream(self._seed, setup, trial, condition, "donors")
        chosen: list[ObjectFacts] = []
        for present in self._of(trial):
            candidates = self._candidates(present, condition)
            unused = [facts for facts in candidates if facts not in chosen] or candidates
            chosen.append(unused[int(rng.integers(len(unused)))])
        return tuple(chosen)

    def objects(self, setup: str, trial: int, condition: str) -> tuple[DemonstratedObject, ...]:
        """As `choose`, with the demonstrations."""
        return tuple(
            DemonstratedObject(self._read(facts.trial), facts.number) for facts in self.choose(setup, trial, condition)
        )

    def _candidates(self, present: ObjectFacts, condition: str) -> list[ObjectFacts]:
        """All possible donors of an object in order of trial and number, at least one."""
        for place in range(len(self._numbers)):
            same_categories = self._by_categories(place).get(present.categories, [])
            alike = [facts for facts in same_categories if facts.trial != present.trial]
            same_food = [facts for facts in alike if facts.food == present.food]
            other_food = [facts for facts in alike if facts.food != present.food]
            found = other_food if condition == OTHER_FOOD else same_food or other_food
            if found:
                return found
        kind = "an object of another food" if condition == OTHER_FOOD else "an object"
        raise InputError(
            f"trial {present.trial} has no {condition} goal: no other trial outside the training set has {kind} cut "
            f"into {' and '.join(sorted(present.categories))}, as its {present.food} is; collect more trials, leave "
            "its setup out with --setups, or leave out these goals"
        )

    def _by_categories(self, place: int) -> dict[frozenset[str], list[ObjectFacts]]:
        """Categories -> the objects cut into them, in order of trial and number, of the test trials or of the spare."""
        if place not in self._alike:
            self._alike[place] = {}
            for number in self._numbers[place]:
                for facts in self._of(number):
                    self._alike[place].setdefault(facts.categories, []).append(facts)
        return self._alike[place]

    def _of(self, trial: int) -> tuple[ObjectFacts, ...]:
        if trial not in self._facts:
            self._facts[trial] = object_facts(self._read(trial))
        return self._facts[trial]
