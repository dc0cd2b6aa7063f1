"""The board: a SAPIEN world where fragments are rigid bodies and a free knife makes the cut.

"Depth and lock": the fragments are held while the blade passes through the section; when its edge has come out at the
far side the fragments are sliced, the halves are parted by the blade's thickness, and all are let go and settle. The
knife may come from any direction within the plane (see `blade`). It cuts only what the cut means: where every way
passes another fragment, the cut is refused.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Stream
from cutgrammar.settings import Settings, WorldSettings
from cutgrammar_sim.physics.bodies import Bodies
from cutgrammar_sim.physics.hulls import HullError
from cutgrammar_sim.worlds.division import divide
from cutgrammar_sim.worlds.free_knife import find_stroke


class Board:
    """A `World` of rigid fragments; `observe` is exact.

    Attributes:
        knife: X_WB of the blade at every simulated step of the last cut (see `Bodies.sweep`).
    """

    def __init__(self, settings: WorldSettings) -> None:
        self._settings = settings
        self._bodies = Bodies(settings)
        self._entities: list[Any] = []
        self._now: Configuration = ()
        self.knife: list[Pose] = []

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration in a fresh scene and let it settle; what reaches under the board is raised.

        Raises:
            TypeError: a fragment is known as a point cloud only.
            HullError: a fragment is too thin for the simulator.
        """
        del foods  # a free knife meets no force
        self._bodies = Bodies(self._settings)
        raised = [on_board(fragment) for fragment in start]
        self._entities = [self._bodies.add(fragment, self._bodies.shapes(fragment.mesh)) for fragment in raised]
        self._now = tuple(raised)
        self.knife = []
        self._settle()

    def observe(self) -> Configuration:
        """The current fragments as they lie."""
        return self._now

    def truth(self) -> Configuration:
        """The current fragments as they lie."""
        return self._now

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Sweep the knife through the fragments meant, put their products in their place and let all settle."""
        divided = divide(self._now, cut, self._settings.min_share)
        if isinstance(divided, Refused):
            return divided
        stroke = find_stroke(self._now, tuple(divided), cut.plane_W)
        if isinstance(stroke, Refused):
            return stroke
        try:
            shapes = {i: [self._bodies.shapes(mesh) for mesh in sliced.products] for i, sliced in divided.items()}
        except HullError as error:
            return Refused(str(error))
        thickness = self._settings.blade_thickness_mm * 1e-3
        self._bodies.hold(self._entities)
        self.knife = self._bodies.sweep(stroke, cut.plane_W.normal, thickness)
        now: list[Fragment] = []
        entities: list[Any] = []
        for index, (fragment, entity) in enumerate(zip(self._now, self._entities, strict=True)):
            if index not in divided:
                now.append(fragment)
                entities.append(entity)
                continue
            self._bodies.remove(entity)
            products = parted(fragment, divided[index], cut.plane_W.normal * thickness)
            now.extend(products)
            entities.extend(
                self._bodies.add(product, pieces) for product, pieces in zip(products, shapes[index], strict=True)
            )
        self._now, self._entities = tuple(now), entities
        self._bodies.release(entities)
        if not self._settle():
            return Failed("a fragment left the board")
        return Done(sum(len(sliced.products) for sliced in divided.values()))

    def speed(self) -> float:
        """Greatest speed of any fragment now, after it has settled [m/s]."""
        return self._bodies.speed(self._entities)

    def _settle(self) -> bool:
        on_board = self._bodies.settle(self._entities)
        self._now = tuple(
            Fragment(fragment.shape, self._bodies.pose(entity))
            for fragment, entity in zip(self._now, self._entities, strict=True)
        )
        return on_board


def on_board(fragment: Fragment) -> Fragment:
    """The fragment raised just so far that nothing of it is under the board's top, z = 0 of W.

    Raises:
        TypeError: it is known as a point cloud only.
    """
    return Fragment(fragment.mesh, _raised(fragment.X_WF, max(0.0, -_lowest(fragment))))


def parted(fragment: Fragment, sliced: Sliced, gap_W: Floats) -> list[Fragment]:
    """The products of `fragment`, those above the plane moved by half of `gap_W` (3,) [m] and the others back by half.

    Where that would press a product into the board, all are raised together.
    """
    moved = [
        Fragment(mesh, Pose(fragment.X_WF.rotation, fragment.X_WF.position + half * gap_W))
        for side, half in ((sliced.above, 0.5), (sliced.below, -0.5))
        for mesh in side
    ]
    floor = min(_lowest(fragment), 0.0)
    rise = max(0.0, floor - min(_lowest(product) for product in moved))
    return [Fragment(product.shape, _raised(product.X_WF, rise)) for product in moved]


def make_world(settings: Settings, stream: Stream) -> Board:
    """A board for one trial; it has no noise, so `stream` is left alone."""
    del stream
    return Board(settings.world)


def _lowest(fragment: Fragment) -> float:
    return float(fragment.X_WF.apply(fragment.mesh.vertices)[:, 2].min())


def _raised(X_WF: Pose, rise: float) -> Pose:
    return Pose(X_WF.rotation, X_WF.position + np.array([0.0, 0.0, rise]))
