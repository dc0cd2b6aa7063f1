"""The board: a SAPIEN world where fragments are rigid bodies and a free knife makes the cut.

"Depth and lock": the fragments are held while the blade passes through the section; when its edge has come out at the
far side the fragments are sliced, the halves are parted by the blade's thickness, and all are released and settle. The
knife may come from any direction within the plane (see `free_knife`). It cuts only what the cut means: where every
direction passes another fragment, the cut is refused.
"""

from collections.abc import Sequence

from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Stream
from cutgrammar.settings import Settings, WorldSettings
from cutgrammar_sim.worlds.division import divide
from cutgrammar_sim.worlds.free_knife import find_stroke
from cutgrammar_sim.worlds.lying_fragments import LyingFragments, parted


class Board:
    """A `World` of rigid fragments; `observe` is exact.

    Attributes:
        knife: X_WB of the blade at every simulated step of the last cut (see `Bodies.sweep`).
    """

    def __init__(self, settings: WorldSettings) -> None:
        self._settings = settings
        self._lying = LyingFragments(settings)
        self.knife: list[Pose] = []

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration in a fresh scene and let it settle; what reaches under the board is raised.

        Raises:
            TypeError: a fragment is known as a point cloud only.
            HullError: a fragment is too thin for the simulator.
        """
        del foods  # a free knife meets no force
        self._lying = LyingFragments(self._settings)
        self._lying.lay_out(start)
        self.knife = []
        self._lying.settle()

    def observe(self) -> Configuration:
        """The current fragments as they lie."""
        return self._lying.now

    def truth(self) -> Configuration:
        """The current fragments as they lie."""
        return self._lying.now

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Sweep the knife through the fragments meant, put their products in their place and let all settle."""
        lying = self._lying
        divided = divide(lying.now, cut, self._settings.min_share)
        if isinstance(divided, Refused):
            return divided
        stroke = find_stroke(lying.now, tuple(divided), cut.plane_W)
        if isinstance(stroke, Refused):
            return stroke
        shapes = {}
        for index, sliced in divided.items():
            cooked = lying.shapes_of(sliced.products)
            if isinstance(cooked, str):
                return Refused(cooked)
            shapes[index] = cooked
        thickness = self._settings.blade_thickness_mm * 1e-3
        lying.bodies.hold(lying.entities)
        self.knife = lying.bodies.sweep(stroke, cut.plane_W.normal, thickness)
        gap_W = cut.plane_W.normal * thickness
        lying.replace(
            {
                index: list(zip(parted(lying.now[index], sliced, gap_W), shapes[index], strict=True))
                for index, sliced in divided.items()
            }
        )
        lying.bodies.release(lying.entities)
        if not lying.settle():
            return Failed("a fragment left the board")
        return Done(sum(len(sliced.products) for sliced in divided.values()))


def make_world(settings: Settings, stream: Stream) -> Board:
    """SAPIEN with a free knife: the fragments settle after every cut. No noise is drawn from `stream`."""
    del stream
    return Board(settings.world)
