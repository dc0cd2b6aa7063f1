"""Parameters of how each category is cut: numbers of fragments, and proportions that look like the category."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from cutgrammar.geometry.fragment import Mesh


@dataclass(frozen=True)
class Habit:
    """How a category is cut.

    Attributes:
        spacing: target distance of the planes across the long axis, in diameters; None: no such planes.
        whole: minimum and maximum number of fragments along the long axis of a whole object.
        region: the same for a region of an object.
        crosswise: options for the numbers of fragments along y and z; one is drawn for a whole object, and a region
            gets the first. The larger number is used for the wider direction.
        looks: minimum and maximum spacing, in diameters, at which fragments look like the category; if `spacing` is
            None, minimum and maximum length.
    """

    spacing: float | None
    whole: tuple[int, int]
    region: tuple[int, int]
    crosswise: tuple[tuple[int, int], ...]
    looks: tuple[float, float]


HABITS: Mapping[str, Habit] = MappingProxyType(
    {
        "chunks": Habit(0.8, (2, 5), (2, 3), ((1, 1),), (0.6, 1.3)),
        "slices": Habit(0.42, (4, 9), (3, 5), ((1, 1),), (0.2, 0.62)),
        "cubes": Habit(0.65, (2, 3), (2, 3), ((2, 2),), (0.35, 0.9)),
        "strips": Habit(None, (1, 1), (1, 1), ((2, 2), (3, 2)), (1.5, 9.0)),
    }
)


def looks_right(habit: Habit, length: float, region: bool) -> bool:
    """Whether an object of `length` diameters can be cut into fragments that look like the category of `habit`."""
    spacing = length / count_across(habit, length, region)
    return habit.looks[0] <= spacing <= habit.looks[1]


def count_across(habit: Habit, length: float, region: bool) -> int:
    """Number of fragments along an object of `length` diameters."""
    if habit.spacing is None:
        return 1
    lower, upper = habit.region if region else habit.whole
    return int(np.clip(round(length / habit.spacing), lower, upper))


def counts_of_dice(mesh: Mesh, number: int) -> tuple[int, int, int]:
    """Numbers of fragments along x, y and z that make `number` together, with boxes as nearly cubic as possible."""
    extents = np.ptp(mesh.vertices, axis=0)
    divisors = [n for n in range(1, number + 1) if number % n == 0]
    options = [(x, y, number // (x * y)) for x in divisors for y in divisors if number % (x * y) == 0]
    return min(options, key=lambda counts: (round(float(np.ptp(np.log(extents / counts))), 9), counts))


def slenderness(mesh: Mesh) -> float:
    """Length along x in diameters, where the diameter is the geometric mean of width and height."""
    length, width, height = np.ptp(mesh.vertices, axis=0)
    return float(length / np.sqrt(width * height))
