"""The scripted demonstrator: cuts foods into chunks, slices, cubes and strips as people do, with people's error (IV-A).

It stands in for the paper's human demonstrations. One fragment is cut at a time and nothing is moved: the products keep
the frame and the pose of what they were cut from.

- Slices are taken off one after another from one end; everything else is halved, the middle plane of those still to be
  cut first, the direction with the larger count first (x before y before z where they tie).
- Each cut is planned on the fragment at hand: the plane stands at its share of the fragment's own extent, and misses
  that place with a normal error whose standard deviation is `offset_error` times the spacing to the neighbouring
  planes; it is tilted by a normal angle of `tilt_error_deg` about a random line in it. Both are cut off at two standard
  deviations, and an error that makes the plane meet a neighbouring cut within the fragment, or miss the fragment, is
  drawn again.
- Where a goal has more categories than there are objects, an object is first cut across into regions of equal length
  with a category each.
- Counts follow the proportions of what is cut: length / count comes close to `Habit.spacing` diameters, within limits.
  A food whose fragments would not look like the category (`Habit.looks`: too slender for dice, too stubby for two
  regions of chunks) is put back and another drawn; after `DRAWS` of them the last is cut all the same.

The numbers here, in `habits`, `scripted_cuts` and `foods` are part of what a data set is: `definition_digest` covers
them.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar import seeds
from cutgrammar.demonstration import CATEGORIES, DemonstratedFragment, Demonstration
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.trials.setups import Setup
from cutgrammar_sim.demonstrator.habits import HABITS, looks_right, slenderness
from cutgrammar_sim.demonstrator.scripted_cuts import (
    CRUMB,
    ERROR_DRAWS,
    LARGEST_ERROR,
    SMALLEST_SHARE,
    CuttingBoard,
    cut_object,
)
from cutgrammar_sim.foods import BANANA_TURN_DEG, ON_REQUEST, PROPORTIONS

Food = Callable[[np.random.Generator], Mesh]
"""A food: draws the closed mesh of one object, in its own frame [m]."""

DRAWS = 30
"""Foods drawn for one object before the last is taken as it is."""
YAW_DEG, SHIFT, GAP = 15.0, 0.01, (0.04, 0.07)
"""Layout: greatest yaw [degrees] and greatest shift along x [m], least and greatest gap between objects along y [m]."""


def definition_digest(settings: DemonstratorSettings, foods: Iterable[str] = ()) -> str:
    """sha256 over all that defines the scripted demonstrations but the code: habits, proportions, layout and error.

    Args:
        settings: the demonstrator's error.
        foods: names of what there is to cut; those of `foods.ON_REQUEST` among them are part of the definition too.
    """
    definition: dict[str, object] = {
        "habits": {name: dataclasses.asdict(habit) for name, habit in HABITS.items()},
        "foods": dict(PROPORTIONS),
        "errors": [LARGEST_ERROR, ERROR_DRAWS, SMALLEST_SHARE, CRUMB],
        "layout": [DRAWS, YAW_DEG, SHIFT, GAP],
        "settings": dataclasses.asdict(settings),
    }
    if asked_for := {name: ON_REQUEST[name] for name in foods if name in ON_REQUEST}:
        definition["foods on request"] = [asked_for, BANANA_TURN_DEG]
    return hashlib.sha256(json.dumps(definition, sort_keys=True).encode()).hexdigest()


def make_demonstration(
    trial: int,
    setup: Setup,
    categories: tuple[str, ...],
    foods: Mapping[str, Food],
    seed: int,
    settings: DemonstratorSettings,
) -> Demonstration:
    """Cut N random objects into fragments of M categories.

    The board's top is z = 0 of the world frame W, its centre x = y = 0. The objects lie side by side along y, their
    long axis along x but for a small yaw. Everything random comes from the stream ("demonstration", `trial`).

    Args:
        trial: number within the data set.
        setup: N objects, M categories.
        categories: the M categories of the goal.
        foods: what there is to cut, by name; a food's long axis is x of its frame F.
        seed: of the data set.
        settings: the demonstrator's error.

    Raises:
        ValueError: categories that are unknown, repeated or not M; no foods.
        RuntimeError: a cut that no error drawn made possible, e.g. on a mesh that is not a solid.
    """
    if len(set(categories)) != setup.categories or not set(categories) <= set(CATEGORIES):
        raise ValueError(f"{setup.name} needs {setup.categories} of the categories {CATEGORIES}, not {categories}")
    if not foods:
        raise ValueError("no foods to cut")
    rng = seeds.stream(seed, "demonstration", trial)
    ordered = tuple(name for name in CATEGORIES if name in categories)
    jobs = _shared_out(setup.objects, ordered, rng)
    objects = [_suitable_food(foods, job, rng) for job in jobs]
    board = CuttingBoard([mesh for _, mesh in objects], _layout([mesh for _, mesh in objects], rng))
    for number, job in enumerate(jobs):
        cut_object(board, number, job, rng, settings)
    return Demonstration(
        trial=trial,
        setup=setup.name,
        foods=tuple(name for name, _ in objects),
        categories=ordered,
        demonstrator="scripted",
        seed=seed,
        fragments=tuple(
            DemonstratedFragment(i, parent, step, board.categories.get(i), mesh)
            for i, (parent, step, mesh) in enumerate(board.fragments)
        ),
        poses=dict(board.poses),
        cuts=tuple(board.cuts),
    )


def _shared_out(objects: int, categories: Sequence[str], rng: np.random.Generator) -> list[tuple[str, ...]]:
    """The categories of every object, one or more, so that all are covered."""
    shuffled = [str(name) for name in rng.permutation(list(categories))]
    spare = [str(name) for name in rng.choice(list(categories), size=max(objects - len(shuffled), 0))]
    jobs = [[name] for name in (shuffled + spare)[:objects]]
    rng.shuffle(jobs)
    for i, name in enumerate(shuffled[objects:]):  # the surplus: one region each, spread over the objects
        jobs[i % objects].append(name)
    return [tuple(str(name) for name in rng.permutation(job)) for job in jobs]


def _suitable_food(foods: Mapping[str, Food], job: tuple[str, ...], rng: np.random.Generator) -> tuple[str, Mesh]:
    """Name and mesh of a food that can be cut into fragments which look like the categories of `job`."""
    names = sorted(foods)
    for _ in range(DRAWS):
        name = names[rng.integers(len(names))]
        mesh = foods[name](rng)
        length = slenderness(mesh) / len(job)
        if all(looks_right(HABITS[category], length, len(job) > 1) for category in job):
            break
    return name, mesh


def _layout(meshes: Sequence[Mesh], rng: np.random.Generator) -> list[Pose]:
    """X_WF of every object: side by side along y about the board's centre, lowest point at z = 0."""
    turns, boxes = [], []
    for mesh in meshes:
        turns.append(Rotation.from_euler("z", rng.uniform(-YAW_DEG, YAW_DEG), degrees=True).as_matrix())
        turned = mesh.vertices @ turns[-1].T
        boxes.append(np.stack([turned.min(axis=0), turned.max(axis=0)]))
    gaps = rng.uniform(*GAP, size=len(meshes))
    total = sum(box[1, 1] - box[0, 1] for box in boxes) + gaps[1:].sum()
    y, poses = -total / 2.0, []
    for rotation, box, gap in zip(turns, boxes, [0.0, *gaps[1:]], strict=True):
        y += gap
        x = rng.uniform(-SHIFT, SHIFT) - (box[0, 0] + box[1, 0]) / 2.0
        poses.append(Pose(rotation, np.array([x, y - box[0, 1], -box[0, 2]])))
        y += box[1, 1] - box[0, 1]
    return poses
