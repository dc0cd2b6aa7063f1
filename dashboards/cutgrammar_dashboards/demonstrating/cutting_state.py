"""The fragments of one demonstration while it is made: cuts and undone cuts, as a value that every action replaces.

Nothing moves: products keep the frame and pose of the fragment they were cut from, as those of the scripted
demonstrator. An undone cut stays in the record, and undoing it is a step of its own.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, Demonstration, HandStroke
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Missed, Sliced, slice_mesh
from cutgrammar_dashboards.demonstrating.task import Task

MIN_SHARE = 1e-3
"""Minimum volume of a product, as a share of its fragment; otherwise the plane counts as a miss, as in the worlds."""
APART = 0.6
"""Fragments that are shown fully apart are moved by this share of their distance from the middle of their object."""


@dataclass(frozen=True, eq=False)
class CuttingState:
    """What has been done of a task.

    Attributes:
        task: the task.
        fragments: (parent, step, number of the object, mesh) of every fragment there was, by id.
        alive: ids of the fragments that exist now, ascending.
        history: the ids alive after every step, from step 0.
        cuts: all cuts, in their order.
        strokes: how they were made.
    """

    task: Task
    fragments: tuple[tuple[int | None, int, int, Mesh], ...]
    alive: tuple[int, ...]
    history: tuple[tuple[int, ...], ...]
    cuts: tuple[DemonstratedCut, ...] = ()
    strokes: tuple[HandStroke, ...] = ()

    @property
    def made(self) -> tuple[DemonstratedCut, ...]:
        """The cuts that were not undone."""
        return tuple(cut for cut in self.cuts if not cut.undone)

    def fragment(self, number: int) -> Fragment:
        """The fragment with this id, in its place."""
        return Fragment(self.fragments[number][3], self._pose(number))

    def object_of(self, fragment: int) -> int:
        """The number of the object that a fragment was cut from."""
        return self.fragments[fragment][2]

    def shifts(self) -> Mapping[int, Floats]:
        """Shifts (3,) [m] by which the fragments that exist are moved when they are shown fully apart."""
        owners = [self.object_of(i) for i in self.alive]
        return dict(zip(self.alive, shifts_apart([self.fragment(i) for i in self.alive], owners), strict=True))

    def divided(self, fragment: int, plane_W: Plane) -> Sliced | Missed:
        """What a cut would make of a fragment, in its frame F."""
        plane_F = plane_W.transformed(self._pose(fragment).inverse())
        return slice_mesh(self.fragments[fragment][3], plane_F, MIN_SHARE)

    def cut(self, fragment: int, plane_W: Plane, stroke: HandStroke) -> "CuttingState | Missed":
        """The state after a cut, or why the plane does not divide the fragment.

        Args:
            fragment: id of a fragment that exists.
            plane_W: cutting plane.
            stroke: how it was made; its step is set here.
        """
        sliced = self.divided(fragment, plane_W)
        if isinstance(sliced, Missed):
            return sliced
        step, first = len(self.history), len(self.fragments)
        products = tuple(range(first, first + len(sliced.products)))
        mesh, X_WF = self.fragments[fragment][3], self._pose(fragment)
        plane_C = plane_W.transformed((X_WF @ canonical_frame(mesh)).inverse())
        alive = tuple(i for i in self.alive if i != fragment) + products
        number = self.object_of(fragment)
        return dataclasses.replace(
            self,
            fragments=self.fragments + tuple((fragment, step, number, product) for product in sliced.products),
            alive=alive,
            history=(*self.history, alive),
            cuts=(*self.cuts, DemonstratedCut(step, plane_W, plane_C, fragment, products)),
            strokes=(*self.strokes, dataclasses.replace(stroke, step=step)),
        )

    def undo(self, seconds: float) -> "CuttingState":
        """The state after the last cut that still stands is undone, at this time since the task was shown [s].

        Raises:
            ValueError: there is no cut to undo.
        """
        standing = [i for i, cut in enumerate(self.cuts) if not cut.undone]
        if not standing:
            raise ValueError("there is no cut to undo")
        index, cuts, strokes = standing[-1], list(self.cuts), list(self.strokes)
        cut = cuts[index]
        cuts[index] = dataclasses.replace(cut, undone=True)
        strokes[index] = dataclasses.replace(strokes[index], undone_seconds=seconds)
        alive = tuple(sorted({cut.fragment, *self.alive} - set(cut.products)))
        return dataclasses.replace(
            self, alive=alive, history=(*self.history, alive), cuts=tuple(cuts), strokes=tuple(strokes)
        )

    def unfinished(self) -> tuple[str, ...]:
        """The names of the objects that are still whole."""
        whole = [i for i in self.alive if i < len(self.task.start)]
        return tuple(self.task.names[i] for i in whole)

    def demonstration(self, demonstrator: str) -> Demonstration:
        """The finished demonstration."""
        task = self.task
        return Demonstration(
            trial=task.trial,
            setup=task.setup,
            foods=task.foods,
            categories=task.categories,
            demonstrator=demonstrator,
            seed=task.seed,
            fragments=tuple(
                DemonstratedFragment(i, parent, step, self._category(i), mesh)
                for i, (parent, step, _, mesh) in enumerate(self.fragments)
            ),
            poses={(step, i): self._pose(i) for step, alive in enumerate(self.history) for i in alive},
            cuts=self.cuts,
            strokes=self.strokes,
        )

    def _category(self, fragment: int) -> str | None:
        if fragment not in self.alive:
            return None
        _, _, number, mesh = self.fragments[fragment]
        return self.task.category_at(number, float(mesh.centroid[0]))

    def _pose(self, fragment: int) -> Pose:
        return self.task.start[self.object_of(fragment)].X_WF


def shifts_apart(fragments: Sequence[Fragment], objects: Sequence[int]) -> list[Floats]:
    """Shifts (3,) [m] that move fragments apart from the middle of their object, none of them downwards.

    Args:
        fragments: at least one, in their places.
        objects: the number of the object that each was cut from.
    """
    centres = np.array([fragment.p_WC for fragment in fragments])
    shifts = np.empty_like(centres)
    for number in set(objects):
        own = np.array(objects) == number
        shifts[own] = APART * (centres[own] - (centres[own].min(axis=0) + centres[own].max(axis=0)) / 2.0)
    return list(shifts - [0.0, 0.0, shifts[:, 2].min()])


def new_state(task: Task) -> CuttingState:
    """The state before the first cut."""
    alive = tuple(range(len(task.start)))
    return CuttingState(task, tuple((None, 0, i, whole.mesh) for i, whole in enumerate(task.start)), alive, (alive,))
