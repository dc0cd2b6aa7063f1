"""The scripted demonstrator: cuts foods into chunks, slices, cubes and strips as people do, with people's error (IV-A).

It stands in for the paper's human demonstrations. One fragment is cut at a time and nothing is moved: the products keep
the frame and the pose of what they were cut from.

- Slices are taken off one after another from one end; everything else is halved, the middle plane of those still to be
  cut first, the direction with the larger count first (x before y before z where they tie).
- Each cut is planned on the fragment at hand: the plane stands at its share of the fragment's own extent, and misses
  that place with a normal error whose standard deviation is `offset_error` times the spacing to the neighbouring
  planes; it is tilted by a normal angle of `tilt_error_deg` about a random line in it. Both are cut off at
  `LARGEST_ERROR` standard deviations, and an error that makes the plane meet a neighbouring cut within the fragment,
  or miss the fragment, is drawn again.
- Where a goal has more categories than there are objects, an object is first cut across into regions of equal length
  with a category each.
- Counts follow the proportions of what is cut: length / count comes close to `spacing` diameters, within the limits
  of `HABITS`. A food whose fragments would not look like the category (`looks`: too slender for dice, too stubby
  for two regions of chunks) is put back and another drawn; after `DRAWS` of them the last is cut all the same.

The numbers here and in `foods.PROPORTIONS` are part of what a data set is: `definition_digest` covers them.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar import seeds
from cutgrammar.demonstrations import CATEGORIES, DemonstratedCut, DemonstratedFragment, Demonstration
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.trials.setups import Setup
from cutgrammar_sim.foods import PROPORTIONS

Food = Callable[[np.random.Generator], Mesh]


@dataclass(frozen=True)
class Habit:
    """How a category is cut.

    Attributes:
        spacing: wanted distance of the planes across the long axis, in diameters; None: no such planes.
        whole: least and greatest number of fragments along the long axis of a whole object.
        region: the same for a region of an object.
        crosswise: (along y, along z) numbers of fragments; of several the stream takes one for a whole object, and
            a region gets the first. The larger number goes to the wider direction.
        looks: least and greatest spacing, in diameters, at which fragments still look like the category; for None
            above, length of what is cut.
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
LARGEST_ERROR = 2.0
"""Errors are cut off at this many standard deviations."""
SMALLEST_SHARE = 1e-3
"""A plane that would leave a product with a smaller share of the fragment counts as a miss, as it does in the worlds."""
CRUMB = 0.1
"""Of several products on one side of a cut, those under this share of that side are not cut further."""
ERROR_DRAWS = 200
"""Errors drawn for one cut before the demonstrator gives up."""
DRAWS = 30
"""Foods drawn for one object before the last is taken as it is."""
YAW_DEG, SHIFT, GAP = 15.0, 0.01, (0.04, 0.07)
"""Layout: greatest yaw [degrees] and greatest shift along x [m], least and greatest gap between objects along y [m]."""


def definition_digest(settings: DemonstratorSettings) -> str:
    """sha256 over all that defines the scripted demonstrations but the code: habits, proportions, layout and error."""
    definition = {
        "habits": {name: dataclasses.asdict(habit) for name, habit in HABITS.items()},
        "foods": dict(PROPORTIONS),
        "errors": [LARGEST_ERROR, ERROR_DRAWS, SMALLEST_SHARE, CRUMB],
        "layout": [DRAWS, YAW_DEG, SHIFT, GAP],
        "settings": dataclasses.asdict(settings),
    }
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
    board = _Board([mesh for _, mesh in objects], _layout([mesh for _, mesh in objects], rng))
    for number, job in enumerate(jobs):
        _cut_object(board, number, job, rng, settings)
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
        poses=MappingProxyType(dict(board.poses)),
        cuts=tuple(board.cuts),
    )


# --- what is to be cut into what --------------------------------------------------------------------------------------


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
        length = _slenderness(mesh) / len(job)
        if all(_looks_right(HABITS[category], length, len(job) > 1) for category in job):
            break
    return name, mesh


def _looks_right(habit: Habit, length: float, region: bool) -> bool:
    spacing = length / _count_across(habit, length, region)
    return habit.looks[0] <= spacing <= habit.looks[1]


def _count_across(habit: Habit, length: float, region: bool) -> int:
    """Number of fragments along something `length` diameters long."""
    if habit.spacing is None:
        return 1
    least, most = habit.region if region else habit.whole
    return int(np.clip(round(length / habit.spacing), least, most))


def _slenderness(mesh: Mesh) -> float:
    """Length along x in diameters, the diameter being the geometric mean of width and height."""
    length, width, height = np.ptp(mesh.vertices, axis=0)
    return float(length / np.sqrt(width * height))


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


# --- cutting ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Task:
    """What is still to be done to a fragment.

    Attributes:
        fragment: its id.
        regions: the categories of its regions, from -x to +x.
        region: it is a region of an object.
        counts: numbers of fragments along x, y, z of F it is to become, None before that is decided.
        end: slices are taken from this end of x, -1 or 1.
        walls: (direction, plane in F) of the cuts that bound it.
    """

    fragment: int
    regions: tuple[str, ...]
    region: bool = False
    counts: tuple[int, int, int] | None = None
    end: int = 1
    walls: tuple[tuple[int, Plane], ...] = ()


class _Board:
    """The demonstration so far."""

    def __init__(self, meshes: Sequence[Mesh], layout: Sequence[Pose]) -> None:
        self.fragments: list[tuple[int | None, int, Mesh]] = [(None, 0, mesh) for mesh in meshes]
        self.alive: dict[int, Pose] = dict(enumerate(layout))
        self.poses: dict[tuple[int, int], Pose] = {(0, i): pose for i, pose in self.alive.items()}
        self.categories: dict[int, str] = {}
        self.cuts: list[DemonstratedCut] = []

    def mesh(self, fragment: int) -> Mesh:
        return self.fragments[fragment][2]

    def cut(self, fragment: int, plane_F: Plane, sliced: Sliced) -> tuple[int, ...]:
        """Put the products in the place of `fragment`; their ids, those above the plane first."""
        step, mesh = len(self.cuts) + 1, self.mesh(fragment)
        X_WF = self.alive.pop(fragment)
        products = tuple(range(len(self.fragments), len(self.fragments) + len(sliced.products)))
        self.fragments += [(fragment, step, product) for product in sliced.products]
        self.alive |= dict.fromkeys(products, X_WF)
        self.poses |= {(step, i): pose for i, pose in self.alive.items()}
        plane_C = plane_F.seen_from(canonical_frame(mesh).inverse())
        self.cuts.append(DemonstratedCut(step, plane_F.seen_from(X_WF), plane_C, fragment, products))
        return products


def _cut_object(
    board: _Board, number: int, job: tuple[str, ...], rng: np.random.Generator, settings: DemonstratorSettings
) -> None:
    """Cut object `number` into all its fragments, those that appeared first first."""
    tasks = [_Task(number, job, region=len(job) > 1)]
    while tasks:
        task = tasks.pop(0)
        if len(task.regions) == 1 and task.counts is None:
            task = _decided(board.mesh(task.fragment), task, rng)
        if task.counts == (1, 1, 1):
            board.categories[task.fragment] = task.regions[0]
        else:
            tasks += _cut_once(board, task, rng, settings)


def _decided(mesh: Mesh, task: _Task, rng: np.random.Generator) -> _Task:
    """The task with the counts along x, y and z that suit its category and the proportions of `mesh`."""
    habit = HABITS[task.regions[0]]
    across = _count_across(habit, _slenderness(mesh), task.region)
    choice = 0 if task.region else int(rng.integers(len(habit.crosswise)))
    more, fewer = habit.crosswise[choice]
    _, width, height = np.ptp(mesh.vertices, axis=0)
    sideways = (more, fewer) if width >= height else (fewer, more)
    return dataclasses.replace(task, counts=(across, *sideways), end=int(rng.choice([-1, 1])))


def _cut_once(board: _Board, task: _Task, rng: np.random.Generator, settings: DemonstratorSettings) -> list[_Task]:
    """Make the next cut of a fragment; what is then to be done to its products."""
    if task.counts is None:  # between regions
        axis, first, of = 0, len(task.regions) // 2, len(task.regions)
        below = dataclasses.replace(task, regions=task.regions[:first])
        above = dataclasses.replace(task, regions=task.regions[first:])
    else:
        axis = int(np.argmax(task.counts))
        of = task.counts[axis]
        first = of // 2
        if task.regions[0] == "slices":
            first = 1 if task.end < 0 else of - 1
        below = dataclasses.replace(task, counts=_with(task.counts, axis, first))
        above = dataclasses.replace(task, counts=_with(task.counts, axis, of - first))
    mesh = board.mesh(task.fragment)
    walls = [wall for direction, wall in task.walls if direction == axis]
    plane, sliced = _clean_cut(mesh, axis, first, of, walls, rng, settings)
    products = board.cut(task.fragment, plane, sliced)
    sides = (above,) * len(sliced.above) + (below,) * len(sliced.below)
    wholes = (sum(m.volume for m in sliced.above), sum(m.volume for m in sliced.below))
    tasks = []
    for product, side in zip(products, sides, strict=True):
        done = board.mesh(product).volume < CRUMB * wholes[0 if side is above else 1]
        tasks.append(
            dataclasses.replace(
                side,
                fragment=product,
                walls=(*task.walls, (axis, plane)),
                regions=side.regions[:1] if done else side.regions,
                counts=(1, 1, 1) if done else side.counts,
            )
        )
    return tasks


def _with(counts: tuple[int, int, int], axis: int, count: int) -> tuple[int, int, int]:
    changed = list(counts)
    changed[axis] = count
    return changed[0], changed[1], changed[2]


def _clean_cut(
    mesh: Mesh,
    axis: int,
    first: int,
    of: int,
    walls: Sequence[Plane],
    rng: np.random.Generator,
    settings: DemonstratorSettings,
) -> tuple[Plane, Sliced]:
    """A cut across `axis` of F at `first` / `of` of the fragment's extent, but for the demonstrator's error.

    Raises:
        RuntimeError: no error drawn gave a plane that divides the fragment clear of the `walls`.
    """
    for _ in range(ERROR_DRAWS):
        plane = _planned(mesh, axis, first, of, rng, settings)
        if any(_meets(plane, wall, mesh) for wall in walls):
            continue
        sliced = slice_mesh(mesh, plane, SMALLEST_SHARE)
        if isinstance(sliced, Sliced):
            return plane, sliced
    raise RuntimeError(f"none of {ERROR_DRAWS} planes drawn divides the fragment clear of its other cuts")


def _planned(
    mesh: Mesh, axis: int, first: int, of: int, rng: np.random.Generator, settings: DemonstratorSettings
) -> Plane:
    """The plane at its share of the extent, with an error of offset and tilt drawn from `rng`; in F."""
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    spacing = (highest[axis] - lowest[axis]) / of
    point = (lowest + highest) / 2.0
    point[axis] = lowest[axis] + spacing * (first + settings.offset_error * _error(rng))
    tilt = np.radians(settings.tilt_error_deg * _error(rng))
    about = rng.uniform(0.0, 2.0 * np.pi)
    normal: Floats = np.zeros(3)
    normal[axis] = np.cos(tilt)
    normal[(axis + 1) % 3] = np.sin(tilt) * np.cos(about)
    normal[(axis + 2) % 3] = np.sin(tilt) * np.sin(about)
    return Plane.through(point, normal)


def _error(rng: np.random.Generator) -> float:
    """A standard normal number, drawn again while it is beyond `LARGEST_ERROR`."""
    while abs(number := float(rng.normal())) > LARGEST_ERROR:
        pass
    return number


def _meets(plane: Plane, wall: Plane, mesh: Mesh) -> bool:
    """The plane crosses the face that an earlier cut, `wall`, left on the mesh."""
    face = mesh.vertices[np.abs(wall.distances(mesh.vertices)) < 1e-9]
    if not len(face):
        return False
    sides = plane.distances(face)
    return bool(sides.min() <= 0.0 <= sides.max())
