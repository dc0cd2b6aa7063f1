"""Fragments that lie on the board of a SAPIEN scene: what the worlds with physics share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced
from cutgrammar.settings import WorldSettings
from cutgrammar_sim.physics.bodies import Bodies
from cutgrammar_sim.physics.hulls import HullError


class LyingFragments:
    """Fragments and their bodies in a fresh scene.

    Attributes:
        bodies: the scene.
        entities: the body of each fragment; None where it is taken out of the scene.
        now: the fragments as they lie.
    """

    def __init__(self, settings: WorldSettings, tgs: bool = True) -> None:
        self.bodies = Bodies(settings, tgs)
        self.entities: list[Any] = []
        self.now: Configuration = ()

    def lay_out(self, start: Configuration) -> None:
        """Add the initial configuration; what reaches under the board is raised.

        Raises:
            TypeError: a fragment is known as a point cloud only.
            HullError: a fragment is too thin for the simulator.
        """
        raised = [on_board(fragment) for fragment in start]
        self.entities = [self.bodies.add(fragment, self.bodies.shapes(fragment.mesh)) for fragment in raised]
        self.now = tuple(raised)

    def settle(self, watch: Callable[[int], None] | None = None) -> bool:
        """Step until all fragments rest; whether all stayed on the board. `watch` is called as in `Bodies.settle`."""
        on_the_board = self.bodies.settle(self.entities, watch)
        self.now = tuple(
            Fragment(fragment.shape, self.bodies.pose(entity))
            for fragment, entity in zip(self.now, self.entities, strict=True)
        )
        return on_the_board

    def take_out(self, indices: Sequence[int]) -> None:
        """Take the bodies of some fragments out of the scene until they are replaced."""
        for index in indices:
            self.bodies.remove(self.entities[index])
            self.entities[index] = None

    def replace(self, new: Mapping[int, Sequence[tuple[Fragment, list[Any]]]], held: bool = False) -> list[int]:
        """Put other fragments in the place of some.

        Args:
            new: for the index of each fragment that is replaced, the new fragments with their collision shapes.
            held: whether the new bodies are held.

        Returns:
            For each fragment, the index before the call of itself or of the fragment that it replaces.
        """
        now: list[Fragment] = []
        entities: list[Any] = []
        origins: list[int] = []
        for index, (fragment, entity) in enumerate(zip(self.now, self.entities, strict=True)):
            if index not in new:
                now, entities, origins = [*now, fragment], [*entities, entity], [*origins, index]
                continue
            if entity is not None:
                self.bodies.remove(entity)
            for product, shapes in new[index]:
                body = self.bodies.add(product, shapes)
                if held:
                    self.bodies.hold([body])
                now, entities, origins = [*now, product], [*entities, body], [*origins, index]
        self.now, self.entities = tuple(now), entities
        return origins

    def shapes_of(self, meshes: Sequence[Mesh]) -> list[list[Any]] | str:
        """The collision shapes of each mesh, or why the simulator cannot hold one of them."""
        try:
            return [self.bodies.shapes(mesh) for mesh in meshes]
        except HullError as error:
            return str(error)


def on_board(fragment: Fragment) -> Fragment:
    """The fragment, raised if anything of it is under the board's top, z = 0 of W, just so far that nothing is.

    Raises:
        TypeError: it is known as a point cloud only.
    """
    return shifted(Fragment(fragment.mesh, fragment.X_WF), np.array([0.0, 0.0, max(0.0, -_lowest(fragment))]))


def parted(fragment: Fragment, sliced: Sliced, gap_W: Floats) -> list[Fragment]:
    """The products of `fragment`, those above the plane moved by half of `gap_W` (3,) [m] and the others back by half.

    Where that would press a product into the board, all are raised together.
    """
    moved = [
        shifted(Fragment(mesh, fragment.X_WF), half * gap_W)
        for side, half in ((sliced.above, 0.5), (sliced.below, -0.5))
        for mesh in side
    ]
    floor = min(_lowest(fragment), 0.0)
    rise_W = np.array([0.0, 0.0, max(0.0, floor - min(_lowest(product) for product in moved))])
    return [shifted(product, rise_W) for product in moved]


def shifted(fragment: Fragment, by_W: Floats) -> Fragment:
    """The fragment moved by the vector `by_W` (3,) [m]."""
    return Fragment(fragment.shape, Pose(fragment.X_WF.rotation, fragment.X_WF.position + by_W))


def _lowest(fragment: Fragment) -> float:
    return float(fragment.X_WF.apply(fragment.mesh.vertices)[:, 2].min())
