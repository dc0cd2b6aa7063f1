"""A world seen through two depth cameras: planners see perceived fragments, cuts and scores use true ones (IV-D).

`Perceiving` wraps any world. It looks once in each step, however many cuts are refused in it, with noise from a stream
of that step that is the same for all methods. It uses what a robot knows: the cloud and, if `vision.belief` is on, the
plane of the last cut and where it carried a fragment, for an arm both from its own joint angles.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Sighted, Stream, World
from cutgrammar.motion import Motion
from cutgrammar.perception.vision.belief import KnownCut
from cutgrammar.perception.vision.completion import MIRRORED, WHOLE, hull
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.perception.vision.perceive import Perceived, perceive
from cutgrammar.perception.vision.segmentation import Segmentation
from cutgrammar.settings import Settings
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.cameras.renderers import renderer
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
            self._cut = known_cut(cut, self._now, done.motion)
            self._step += 1
            self._sight = None
        return done


def known_cut(cut: Cut, now: Configuration, motion: Motion | None) -> KnownCut:
    """What is known of a cut after it is made: its plan or, if an arm made it, the actual plane of the blade.

    Args:
        cut: as planned.
        now: the fragments as perceived before it.
        motion: of the arm, if there is one; the poses of the blade and the times of the phases are used.
    """
    crossed = [i for i, fragment in enumerate(now) if crosses(cut.plane_W, fragment)] or list(range(len(now)))
    centres = np.array([now[i].p_WC for i in crossed]).reshape(-1, 3)
    nearest = [int(np.argmin(np.linalg.norm(centres - p_WC, axis=1))) for p_WC in cut.p_WC if len(crossed)]
    meant = tuple(sorted({crossed[i] for i in nearest}))
    if motion is None:
        return KnownCut(cut.plane_W, meant, Pose.identity())
    pressed = _last_sample(motion, "press")
    plane_W, carried = cut.plane_W, Pose.identity()
    if pressed is not None:
        X_WB = Pose.from_vector(motion.X_WB[pressed])
        plane_W = Plane.through(X_WB.position, X_WB.rotation[:, 0])
    picked, placed = _last_sample(motion, "pick"), _last_sample(motion, "place")
    if picked is not None and placed is not None:
        before, after = (Pose.from_vector(motion.X_WB[i]) for i in (picked, placed))
        carried = after @ before.inverse()
    return KnownCut(plane_W, meant, carried)


def _last_sample(motion: Motion, name: str) -> int | None:
    """The last sample of the last phase of this name, None if there is none."""
    ends = [phase.first for phase in motion.phases[1:]] + [len(motion.times)]
    found = [end - 1 for phase, end in zip(motion.phases, ends, strict=True) if phase.name == name]
    return found[-1] if found else None


def scanned_goal(goal: Configuration) -> Configuration:
    """The goal as known from point clouds of whole surfaces, scanned from all sides (IV-D).

    Each cloud has `GOAL_POINTS` evenly spread points without noise and depends on the fragment alone. It is closed by
    its convex hull, as the fragments that cameras see are; a cloud that lies in a plane stays a cloud.
    """
    scanned = []
    for fragment in goal:
        cloud = cloud_of(fragment.shape, GOAL_POINTS)
        scanned.append(Fragment(hull(cloud.points) or cloud, fragment.X_WF))
    return tuple(scanned)


def make_perceiving(world: World, model: "Model", settings: Settings, stream: Stream) -> Perceiving:
    """`world` seen through cameras with the segmentation of `model`.

    Raises:
        InputError: the model has no segmentation.
    """
    if model.segmentation is None:
        raise InputError("this model has no segmentation to see through cameras with; train one with --vision")
    return Perceiving(world, model.segmentation, settings, stream)
