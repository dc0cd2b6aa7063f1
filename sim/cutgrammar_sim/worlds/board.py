"""The board: a SAPIEN world where fragments are rigid bodies and a free knife makes the cut.

"Depth and lock": the fragments are held while the blade passes through the section; when its edge has come out at the
far side the fragments are sliced, the halves are parted by the blade's thickness, and all are released and settle. The
knife may come from any direction within the plane (see `free_knife`). It cuts only what the cut means: where every
direction passes another fragment, the cut is refused.
"""

import math
from collections.abc import Sequence

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Stream
from cutgrammar.settings import Settings, WorldSettings
from cutgrammar_sim.physics.bodies import TIMESTEP, Bodies
from cutgrammar_sim.physics.engine import physx, sapien, sapien_pose
from cutgrammar_sim.worlds.division import divide
from cutgrammar_sim.worlds.free_knife import Stroke, find_stroke
from cutgrammar_sim.worlds.lying_fragments import LyingFragments, parted

BLADE_SPEED = 0.5
"""Speed of the knife's edge during a stroke [m/s]."""


class Board:
    """A `World` of rigid fragments; `observe` is exact.

    Attributes:
        knife: X_WB of the blade at every simulated step of the last cut (see `sweep`).
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
        self.knife = sweep(lying.bodies, stroke, cut.plane_W.normal, thickness)
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


def sweep(bodies: Bodies, stroke: Stroke, normal_W: Floats, thickness: float) -> list[Pose]:
    """Move a knife along `stroke`; its frame B has the edge along y at the origin, and the blade towards z.

    Nothing collides with it: the caller holds all bodies.

    Returns:
        X_WB after every simulated step.
    """
    rotation = np.column_stack([normal_W, np.cross(-stroke.along_W, normal_W), -stroke.along_W])
    half = np.array([max(thickness, 1e-4), stroke.width, stroke.height], dtype=np.float32) / 2.0
    edge = physx.PhysxCollisionShapeBox(half_size=half, material=physx.get_default_material())
    edge.set_local_pose(sapien.Pose(p=[0.0, 0.0, float(half[2])]))
    edge.set_collision_groups([0, 0, 0, 0])
    blade = physx.PhysxRigidDynamicComponent()
    blade.attach(edge)
    blade.set_kinematic(True)
    knife = sapien.Entity()
    knife.add_component(blade)
    knife.set_pose(sapien_pose(Pose(rotation, stroke.p_WE)))
    bodies.scene.add_entity(knife)
    steps = math.ceil(stroke.length / (BLADE_SPEED * TIMESTEP))
    path = []
    for step in range(1, steps + 1):
        path.append(Pose(rotation, stroke.p_WE + stroke.length * step / steps * stroke.along_W))
        blade.set_kinematic_target(sapien_pose(path[-1]))
        bodies.step()
    bodies.remove(knife)
    return path


def make_world(settings: Settings, stream: Stream) -> Board:
    """SAPIEN with a free knife: the fragments settle after every cut. No noise is drawn from `stream`."""
    del stream
    return Board(settings.world)
