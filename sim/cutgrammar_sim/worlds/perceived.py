"""A world seen through two depth cameras: planners see perceived fragments, cuts and scores use true ones (IV-D).

`Perceiving` wraps any world. It looks once in each step, however many cuts are refused in it, with noise from a stream
of that step that is the same for all methods. It uses what a robot knows: the cloud and, if `vision.belief` is on, the
plane of the last cut and where it carried fragments, for an arm both from its own joint angles.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Sighted, Stream, World
from cutgrammar.motion import Motion
from cutgrammar.perception.vision.belief import KnownCut
from cutgrammar.perception.vision.completion import MIRRORED, WHOLE
from cutgrammar.perception.vision.convex_parts import closed_around
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.perception.vision.perceive import Perceived, perceive
from cutgrammar.perception.vision.segmentation import Segmentation
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.cameras.renderers import renderer
from cutgrammar_sim.physics.convex_hull import hull_of
from cutgrammar_sim.worlds.division import crosses

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model

GOAL_POINTS = 4096
"""Number of surface points of a fragment of a goal."""


class Perceiving:
    """A `World` whose `observe` looks through cameras; see `SeesWithCameras`.

    Attributes:
        render_backend: name of the renderer of the cameras' images.
    """

    def __init__(self, world: World, segmentation: Segmentation, settings: Settings, stream: Stream) -> None:
        self._world = world
        self._segmentation = segmentation
        self._settings = settings
        self._stream = stream
        self._renderer = renderer(settings.cameras.renderer)
        self.render_backend = self._renderer.name
        tool = knife(settings)
        self._p_BG = (tool.X_TB.inverse() @ tool.X_TG).position
        self._step = 0
        self._sight: LabelledCloud | None = None
        self._perceived: Perceived | None = None
        self._now: Configuration = ()
        self._cut: KnownCut | None = None

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration, and forget what was seen."""
        self._world.reset(start, foods)
        self._step, self._sight, self._perceived, self._now, self._cut = 0, None, None, (), None

    def observe(self) -> Configuration:
        """The fragments as perceived; the same objects until the next cut."""
        if self._sight is None:
            self._sight = look(
                self._world.truth(), self._settings.cameras, self._stream("look", self._step), render=self._renderer
            )
            before = self._perceived if self._settings.vision.belief else None
            self._perceived = perceive(
                self._sight.points,
                self._sight.normals,
                self._segmentation,
                before,
                None if before is None else self._cut,
                MIRRORED if self._step else WHOLE,
                self._settings.vision.seams,
            )
            self._now = self._perceived.configuration
        return self._now

    def sighted(self, step: int) -> Sighted:
        """What the cameras saw in the last `observe`."""
        self.observe()
        assert self._sight is not None
        assert self._perceived is not None
        return Sighted(step, self._sight.points, self._perceived.labels, self._sight.owners, self._now)

    def truth(self) -> Configuration:
        """The true fragments."""
        return self._world.truth()

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Make the cut in the world behind the cameras."""
        done = self._world.apply(cut)
        if isinstance(done, Done):
            self._cut = known_cut(cut, self._now, done.motion, self._p_BG)
            self._step += 1
            self._sight = None
        return done


def known_cut(cut: Cut, now: Configuration, motion: Motion | None, p_BG: Floats) -> KnownCut:
    """What is known of a cut after it is made: its plan or, if an arm made it, the actual plane of the blade.

    Args:
        cut: as planned.
        now: the fragments as perceived before it.
        motion: of the arm, if there is one; the poses of the blade and the times of the phases are used.
        p_BG: (3,) the gripper's tips in the frame of the blade [m].
    """
    crossed = [i for i, fragment in enumerate(now) if crosses(cut.plane_W, fragment)] or list(range(len(now)))
    centres = np.array([now[i].p_WC for i in crossed]).reshape(-1, 3)
    nearest = [int(np.argmin(np.linalg.norm(centres - p_WC, axis=1))) for p_WC in cut.p_WC if len(crossed)]
    meant = tuple(sorted({crossed[i] for i in nearest}))
    if motion is None:
        return KnownCut(cut.plane_W, meant)
    plane_W = cut.plane_W
    for pressed in _last_samples(motion, "press"):
        X_WB = Pose.from_vector(motion.X_WB[pressed])
        plane_W = Plane.through(X_WB.position, X_WB.rotation[:, 0])
    moves: list[tuple[int, Pose]] = []
    lying = list(now)
    for picked, placed in zip(_last_samples(motion, "pick"), _last_samples(motion, "place"), strict=False):
        before, after = (Pose.from_vector(motion.X_WB[i]) for i in (picked, placed))
        if lying:
            index, X_move = _at(before.apply(p_BG), lying), after @ before.inverse()
            lying[index] = Fragment(lying[index].shape, X_move @ lying[index].X_WF)
            moves.append((index, X_move))
    return KnownCut(plane_W, meant, tuple(moves))


def _at(p_W: Floats, fragments: Sequence[Fragment]) -> int:
    """The fragment that a point (3,) is in, or nearest to, by convex hulls; of several, the one it is deepest in."""
    depths = []
    for fragment in fragments:
        _, _, equations = hull_of(fragment.mesh)
        depths.append(float((equations @ np.append(fragment.X_WF.inverse().apply(p_W), 1.0)).max()))
    return int(np.argmin(depths))


def _last_samples(motion: Motion, name: str) -> list[int]:
    """The last sample of each phase of this name."""
    ends = [phase.first for phase in motion.phases[1:]] + [len(motion.times)]
    return [end - 1 for phase, end in zip(motion.phases, ends, strict=True) if phase.name == name]


def scanned_goal(goal: Configuration) -> Configuration:
    """The goal as known from point clouds of whole surfaces, scanned from all sides (IV-D).

    Each cloud has `GOAL_POINTS` evenly spread points without noise and depends on the fragment alone. It is closed by
    the hulls of its convex parts, as the fragments that cameras see are; a cloud that lies in a plane stays a cloud.
    """
    scanned = []
    for fragment in goal:
        cloud = cloud_of(fragment.shape, GOAL_POINTS)
        scanned.append(Fragment(closed_around(cloud.points) or cloud, fragment.X_WF))
    return tuple(scanned)


def make_perceiving(world: World, model: "Model", settings: Settings, stream: Stream) -> Perceiving:
    """`world` seen through cameras with the segmentation of `model`.

    Raises:
        InputError: the model has no segmentation.
    """
    if model.segmentation is None:
        raise InputError("this model has no segmentation to see through cameras with; train one with --vision")
    return Perceiving(world, model.segmentation, settings, stream)
