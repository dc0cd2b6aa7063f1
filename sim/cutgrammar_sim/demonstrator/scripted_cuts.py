"""Cutting an object into all its fragments, plane by plane, with human-like errors; nothing is moved.

Planes are planned on the current fragment as described in `demonstrate`; errors come from the demonstration's stream.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.demonstration import DemonstratedCut
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.settings import DemonstratorSettings
from cutgrammar_sim.demonstrator.habits import HABITS, count_across, slenderness
from cutgrammar_sim.demonstrator.intents import Intent

MAX_ERROR = 2.0
"""Errors are truncated at this number of standard deviations."""
MIN_SHARE = 1e-3
"""Minimum volume of a product, as a share of its fragment; otherwise the plane counts as a miss, as in the worlds."""
CRUMB = 0.1
"""Products with a smaller share of the volume on their side of a cut are not cut further."""
ERROR_DRAWS = 200
"""Maximum number of draws of the errors of one cut."""


@dataclass(frozen=True)
class _Task:
    """A fragment that is still to be cut.

    Attributes:
        fragment: its id.
        regions: the categories of its regions, from -x to +x.
        region: whether it is a region of an object.
        counts: target numbers of fragments along x, y, z of F; None if not decided yet.
        end: the end of x that slices are cut from, -1 or 1.
        walls: (axis, plane in F) of the cuts that bound it.
    """

    fragment: int
    regions: tuple[str, ...]
    region: bool = False
    counts: tuple[int, int, int] | None = None
    end: int = 1
    walls: tuple[tuple[int, Plane], ...] = ()


class CuttingBoard:
    """The state of a demonstration."""

    def __init__(self, meshes: Sequence[Mesh], layout: Sequence[Pose]) -> None:
        self.fragments: list[tuple[int | None, int, Mesh]] = [(None, 0, mesh) for mesh in meshes]
        self.alive: dict[int, Pose] = dict(enumerate(layout))
        self.poses: dict[tuple[int, int], Pose] = {(0, i): pose for i, pose in self.alive.items()}
        self.categories: dict[int, str] = {}
        self.cuts: list[DemonstratedCut] = []

    def mesh(self, fragment: int) -> Mesh:
        """The mesh of a fragment, in its frame F."""
        return self.fragments[fragment][2]

    def cut(self, fragment: int, plane_F: Plane, sliced: Sliced) -> tuple[int, ...]:
        """Replace `fragment` by its products; return their ids, starting with those above the plane."""
        step, mesh = len(self.cuts) + 1, self.mesh(fragment)
        X_WF = self.alive.pop(fragment)
        products = tuple(range(len(self.fragments), len(self.fragments) + len(sliced.products)))
        self.fragments += [(fragment, step, product) for product in sliced.products]
        self.alive |= dict.fromkeys(products, X_WF)
        self.poses |= {(step, i): pose for i, pose in self.alive.items()}
        plane_C = plane_F.transformed(canonical_frame(mesh).inverse())
        self.cuts.append(DemonstratedCut(step, plane_F.transformed(X_WF), plane_C, fragment, products))
        return products


def cut_object(
    board: CuttingBoard,
    number: int,
    job: tuple[str, ...],
    rng: np.random.Generator,
    settings: DemonstratorSettings,
    counts: tuple[int, int, int] | None = None,
) -> None:
    """Cut object `number` into all its fragments, in the order in which they appear.

    Args:
        board: the state of the demonstration.
        number: of the object.
        job: the categories of its regions.
        rng: random stream of the errors.
        settings: size of the errors.
        counts: numbers of fragments along x, y and z of F; None for those that suit category and proportions.
    """
    tasks = [_Task(number, job, region=len(job) > 1, counts=counts)]
    while tasks:
        task = tasks.pop(0)
        if len(task.regions) == 1 and task.counts is None:
            task = _with_counts(board.mesh(task.fragment), task, rng)
        if task.counts == (1, 1, 1):
            board.categories[task.fragment] = task.regions[0]
        else:
            tasks += _cut_once(board, task, rng, settings)


def _with_counts(mesh: Mesh, task: _Task, rng: np.random.Generator) -> _Task:
    """The task with counts along x, y and z that suit its category and the proportions of `mesh`."""
    habit = HABITS[task.regions[0]]
    across = count_across(habit, slenderness(mesh), task.region)
    choice = 0 if task.region else int(rng.integers(len(habit.crosswise)))
    more, fewer = habit.crosswise[choice]
    _, width, height = np.ptp(mesh.vertices, axis=0)
    sideways = (more, fewer) if width >= height else (fewer, more)
    return dataclasses.replace(task, counts=(across, *sideways), end=int(rng.choice([-1, 1])))


def _cut_once(
    board: CuttingBoard, task: _Task, rng: np.random.Generator, settings: DemonstratorSettings
) -> list[_Task]:
    """Make the next cut of a fragment; return the tasks of its products."""
    if task.counts is None:  # between regions
        intent = Intent(0, len(task.regions) // 2, len(task.regions))
        below = dataclasses.replace(task, regions=task.regions[: intent.below])
        above = dataclasses.replace(task, regions=task.regions[intent.below :])
    else:
        axis = int(np.argmax(task.counts))
        total = task.counts[axis]
        n_below = total // 2
        if task.regions[0] == "slices":
            n_below = 1 if task.end < 0 else total - 1
        intent = Intent(axis, n_below, total)
        below = dataclasses.replace(task, counts=_with(task.counts, axis, n_below))
        above = dataclasses.replace(task, counts=_with(task.counts, axis, total - n_below))
    walls = [wall for axis, wall in task.walls if axis == intent.axis]
    plane, sliced = _clean_cut(board.mesh(task.fragment), intent, walls, rng, settings)
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
                walls=(*task.walls, (intent.axis, plane)),
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
    mesh: Mesh, intent: Intent, walls: Sequence[Plane], rng: np.random.Generator, settings: DemonstratorSettings
) -> tuple[Plane, Sliced]:
    """The intended cut of a fragment, with the demonstrator's errors.

    Raises:
        RuntimeError: no draw gives a plane that divides the fragment without meeting the `walls`.
    """
    for _ in range(ERROR_DRAWS):
        plane = planned_plane((mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)), intent, rng, settings)
        faces = [mesh.vertices[np.abs(wall.distances(mesh.vertices)) < 1e-9] for wall in walls]
        if any(meets(plane, face) for face in faces):
            continue
        sliced = slice_mesh(mesh, plane, MIN_SHARE)
        if isinstance(sliced, Sliced):
            return plane, sliced
    raise RuntimeError(f"none of {ERROR_DRAWS} planes drawn divides the fragment clear of its other cuts")


def planned_plane(
    box: tuple[Floats, Floats], intent: Intent, rng: np.random.Generator, settings: DemonstratorSettings
) -> Plane:
    """The plane of an intended cut, with errors of offset and tilt drawn from `rng`.

    Args:
        box: lower and upper corner (3,), (3,) of the fragment's bounding box in the object's frame F [m].
        intent: the axis of F that the plane is perpendicular to, and its share of the extent.
        rng: random stream of the errors.
        settings: size of the errors.

    Returns:
        The plane in F.
    """
    (lowest, highest), axis = box, intent.axis
    spacing = (highest[axis] - lowest[axis]) / intent.total
    point = (lowest + highest) / 2.0
    point[axis] = lowest[axis] + spacing * (intent.below + settings.offset_error * error(rng))
    tilt = np.radians(settings.tilt_error_deg * error(rng))
    about = rng.uniform(0.0, 2.0 * np.pi)
    normal: Floats = np.zeros(3)
    normal[axis] = np.cos(tilt)
    normal[(axis + 1) % 3] = np.sin(tilt) * np.cos(about)
    normal[(axis + 2) % 3] = np.sin(tilt) * np.sin(about)
    return Plane.through(point, normal)


def error(rng: np.random.Generator) -> float:
    """Draw a standard normal number, truncated at `MAX_ERROR`."""
    while abs(number := float(rng.normal())) > MAX_ERROR:
        pass
    return number


def meets(plane: Plane, face: Floats) -> bool:
    """Whether the plane meets a face with these corners (n, 3), e.g. of an earlier cut."""
    if not len(face):
        return False
    sides = plane.distances(face)
    return bool(sides.min() <= 0.0 <= sides.max())
