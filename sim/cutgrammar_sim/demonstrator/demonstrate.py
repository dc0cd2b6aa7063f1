"""The scripted demonstrator: cuts foods into chunks, slices, cubes and strips with human-like errors (IV-A).

It replaces the paper's human demonstrations. One fragment is cut at a time and nothing is moved: the products keep the
frame and the pose of the fragment they were cut from.

- Slices are cut off one after another from one end. For all other categories the fragment is halved repeatedly, in the
  direction with the largest remaining count (in a tie x before y before z).
- Every cut is planned on the current fragment: the plane is placed at a share of the fragment's extent. Its offset has
  a normal error with a standard deviation of `offset_error` times the spacing of the planes, and it is tilted by a
  normal angle of `tilt_error_deg` about a random line within it. Both errors are truncated at two standard deviations,
  and are drawn again if the plane meets a neighbouring cut within the fragment or misses the fragment.
- If a goal has more categories than objects, an object is first cut across into regions of equal length with one
  category each.
- The number of fragments follows the proportions of the object: length / count is close to `Habit.spacing` diameters,
  within limits. A food whose fragments would not look like the category (`Habit.looks`: too slender for cubes, too
  short for two regions of chunks) is replaced by another draw; after `DRAWS` draws the last food is used anyway.

The numbers in this module, `habits`, `scripted_cuts` and `foods` are part of a data set's definition, which
`definition_digest` covers.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar import seeds
from cutgrammar.demonstration import CATEGORIES, DemonstratedFragment, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.trials.setups import Setup
from cutgrammar_sim.demonstrator.habits import HABITS, counts_of_dice, looks_right, slenderness
from cutgrammar_sim.demonstrator.scripted_cuts import (
    CRUMB,
    ERROR_DRAWS,
    MAX_ERROR,
    MIN_SHARE,
    CuttingBoard,
    cut_object,
)
from cutgrammar_sim.foods import BANANA_TURN_DEG, ON_REQUEST, PROPORTIONS

Food = Callable[[np.random.Generator], Mesh]
"""A food: draws the closed mesh of one object, in its own frame [m]."""

DRAWS = 30
"""Maximum number of foods drawn for one object."""
YAW_DEG, SHIFT, GAP = 15.0, 0.01, (0.04, 0.07)
"""Layout: maximum yaw [degrees], maximum shift along x [m], minimum and maximum gap between objects along y [m]."""


def definition_digest(settings: DemonstratorSettings, foods: Iterable[str] = ()) -> str:
    """sha256 of the numbers that define the scripted demonstrations: habits, proportions, layout and errors.

    Args:
        settings: size of the demonstrator's errors.
        foods: names of the available foods; those of `foods.ON_REQUEST` among them are part of the definition.
    """
    definition: dict[str, object] = {
        "habits": {name: dataclasses.asdict(habit) for name, habit in HABITS.items()},
        "foods": dict(PROPORTIONS),
        "errors": [MAX_ERROR, ERROR_DRAWS, MIN_SHARE, CRUMB],
        "layout": [DRAWS, YAW_DEG, SHIFT, GAP],
        "settings": dataclasses.asdict(settings),
    }
    if on_request := {name: ON_REQUEST[name] for name in foods if name in ON_REQUEST}:
        definition["foods on request"] = [on_request, BANANA_TURN_DEG]
    return hashlib.sha256(json.dumps(definition, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Objects:
    """The objects of a trial before the first cut, and what each is to be cut into.

    Attributes:
        categories: the categories of the goal, in the order of `CATEGORIES`.
        jobs: the categories of every object; several are for equal lengths of it, from -x to +x of its frame F.
        foods: name of every object's food.
        start: the objects in their places.
    """

    categories: tuple[str, ...]
    jobs: tuple[tuple[str, ...], ...]
    foods: tuple[str, ...]
    start: Configuration


def lay_out_objects(
    trial: int, setup: Setup, categories: tuple[str, ...], foods: Mapping[str, Food], seed: int
) -> Objects:
    """The objects of the demonstration that `make_demonstration` makes of the same trial, uncut.

    Args:
        trial: number within the data set.
        setup: N objects, M categories.
        categories: the M categories of the goal.
        foods: the available foods by name.
        seed: seed of the data set.

    Raises:
        ValueError: categories are unknown, repeated or not M, or there are no foods.
    """
    return _lay_out(setup, categories, foods, seeds.stream(seed, "demonstration", trial))


def make_demonstration(
    trial: int,
    setup: Setup,
    categories: tuple[str, ...],
    foods: Mapping[str, Food],
    seed: int,
    settings: DemonstratorSettings,
    dice: int | None = None,
) -> Demonstration:
    """Cut N random objects into fragments of M categories.

    The top of the board is z = 0 of the world frame W, its centre x = y = 0. The objects lie side by side along y, with
    their long axes along x up to a small yaw. All random numbers come from the stream ("demonstration", `trial`).

    Args:
        trial: number within the data set.
        setup: N objects, M categories.
        categories: the M categories of the goal.
        foods: the available foods by name; the long axis of a food is x of its frame F.
        seed: seed of the data set.
        settings: size of the demonstrator's errors.
        dice: cut every object, whatever its proportions, into so many fragments, as nearly cubic as they can be; M
            must be 1. None: into as many as suit its categories and proportions.

    Raises:
        ValueError: categories are unknown, repeated or not M, there are no foods, or M is not 1 with `dice`.
        RuntimeError: no draw of the errors gives a valid cut, e.g. if a mesh is not a solid.
    """
    if dice is not None and len(categories) != 1:
        raise ValueError(f"dice are of one category, not of {len(categories)}")
    rng = seeds.stream(seed, "demonstration", trial)
    objects = _lay_out(setup, categories, foods, rng, any_food=dice is not None)
    board = CuttingBoard([fragment.mesh for fragment in objects.start], [fragment.X_WF for fragment in objects.start])
    for number, job in enumerate(objects.jobs):
        counts = None if dice is None else counts_of_dice(board.mesh(number), dice)
        cut_object(board, number, job, rng, settings, counts)
    return Demonstration(
        trial=trial,
        setup=setup.name,
        foods=objects.foods,
        categories=objects.categories,
        demonstrator="scripted",
        seed=seed,
        fragments=tuple(
            DemonstratedFragment(i, parent, step, board.categories.get(i), mesh)
            for i, (parent, step, mesh) in enumerate(board.fragments)
        ),
        poses=dict(board.poses),
        cuts=tuple(board.cuts),
    )


def _lay_out(
    setup: Setup,
    categories: tuple[str, ...],
    foods: Mapping[str, Food],
    rng: np.random.Generator,
    any_food: bool = False,
) -> Objects:
    """Draw objects and their places; `any_food` takes foods of all proportions."""
    if len(set(categories)) != setup.categories or not set(categories) <= set(CATEGORIES):
        raise ValueError(f"{setup.name} needs {setup.categories} of the categories {CATEGORIES}, not {categories}")
    if not foods:
        raise ValueError("no foods to cut")
    ordered = tuple(name for name in CATEGORIES if name in categories)
    jobs = _assign_categories(setup.objects, ordered, rng)
    drawn = [_suitable_food(foods, () if any_food else job, rng) for job in jobs]
    meshes = [mesh for _, mesh in drawn]
    start = tuple(Fragment(mesh, X_WF) for mesh, X_WF in zip(meshes, _layout(meshes, rng), strict=True))
    return Objects(ordered, tuple(jobs), tuple(name for name, _ in drawn), start)


def _assign_categories(objects: int, categories: Sequence[str], rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Assign one or more categories to every object, such that all categories are used."""
    shuffled = [str(name) for name in rng.permutation(list(categories))]
    spare = [str(name) for name in rng.choice(list(categories), size=max(objects - len(shuffled), 0))]
    jobs = [[name] for name in (shuffled + spare)[:objects]]
    rng.shuffle(jobs)
    for i, name in enumerate(shuffled[objects:]):  # the remaining categories become further regions
        jobs[i % objects].append(name)
    return [tuple(str(name) for name in rng.permutation(job)) for job in jobs]


def _suitable_food(foods: Mapping[str, Food], job: tuple[str, ...], rng: np.random.Generator) -> tuple[str, Mesh]:
    """Draw a food whose fragments look like the categories of `job`, any food for none; return its name and mesh."""
    names = sorted(foods)
    for _ in range(DRAWS):
        name = names[rng.integers(len(names))]
        mesh = foods[name](rng)
        if mesh.volume <= 0.0:
            raise InputError(
                f"food {name!r} draws a mesh of {mesh.volume * 1e6:.3g} ml; it must be closed, and its triangles"
                " counter-clockwise seen from outside"
            )
        length = slenderness(mesh) / max(len(job), 1)
        if all(looks_right(HABITS[category], length, len(job) > 1) for category in job):
            break
    return name, mesh


def _layout(meshes: Sequence[Mesh], rng: np.random.Generator) -> list[Pose]:
    """X_WF of every object: side by side along y about the centre of the board, with their lowest points at z = 0."""
    rotations, boxes = [], []
    for mesh in meshes:
        rotations.append(Rotation.from_euler("z", rng.uniform(-YAW_DEG, YAW_DEG), degrees=True).as_matrix())
        rotated = mesh.vertices @ rotations[-1].T
        boxes.append(np.stack([rotated.min(axis=0), rotated.max(axis=0)]))
    gaps = rng.uniform(*GAP, size=len(meshes))
    total = sum(box[1, 1] - box[0, 1] for box in boxes) + gaps[1:].sum()
    y, poses = -total / 2.0, []
    for rotation, box, gap in zip(rotations, boxes, [0.0, *gaps[1:]], strict=True):
        y += gap
        x = rng.uniform(-SHIFT, SHIFT) - (box[0, 0] + box[1, 0]) / 2.0
        poses.append(Pose(rotation, np.array([x, y - box[0, 1], -box[0, 2]])))
        y += box[1, 1] - box[0, 1]
    return poses
