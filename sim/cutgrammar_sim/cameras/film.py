"""A trial as a film, and as a strip of key frames beside the goal (as the paper's figure 6).

What an arm did is shown as it moved; a cut by a world without one is shown as what was there before and after.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from cutgrammar.events import CutMade, Event
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.motion import Link, Motion
from cutgrammar_sim.cameras.camera import BOARD, FOCAL, Camera, looking_at
from cutgrammar_sim.cameras.food_colours import colours_of, foods_after, largest_facet
from cutgrammar_sim.cameras.painting import TABLE_Z, Body, Picture, body_of, paint

EYE, AT = np.array([0.62, -0.52, 0.48]), np.array([-0.05, 0.02, 0.10])
"""Where the film is taken from, and what is in its middle, in W [m]."""
ZOOM = 1.05
"""Focal length of the film's camera, in that of a depth camera."""
TOWARDS_EYE = np.array([0.72, -0.48, 0.50])
"""Whence key frames and the goal are taken: what is shown in them fills them."""
METAL, SHELL, DARK, WOOD = (0.80, 0.82, 0.84), (0.88, 0.89, 0.90), (0.25, 0.27, 0.30), (0.74, 0.57, 0.38)
INK, HALO = (40, 44, 50), (240, 242, 244)
STILL = 1.0
"""How long the beginning and the end, and a configuration that no arm made, are shown [s]."""


@dataclass(frozen=True)
class FilmSettings:
    """How a film is made.

    Attributes:
        width, height: of its pictures [pixels].
        rate: pictures a second.
        longest: where all would last longer, time runs faster [s].
    """

    width: int = 640
    height: int = 480
    rate: float = 15.0
    longest: float = 30.0


def film_frames(
    start: Configuration,
    goal: Configuration,
    events: Sequence[Event],
    foods: Sequence[str] = (),
    settings: FilmSettings | None = None,
) -> Iterator[Picture]:
    """The pictures of a trial, one after the other, with the goal in the corner.

    Args:
        start: the initial configuration.
        goal: the goal's fragments; those that are clouds are not shown.
        events: what was told of the trial; of these `CutMade` are shown, with their motions.
        foods: what each object of `start` is, by name; without, they have a colour of no food in particular.
        settings: the defaults if none.

    Yields:
        (height, width, 3) uint8, to be shown `settings.rate` a second.
    """
    settings = settings or FilmSettings()
    stage = _Stage(start, foods)
    cuts = [event for event in events if isinstance(event, CutMade)]
    lasts = sum(_seconds(event.motion) for event in cuts)
    faster = max(1.0, lasts / settings.longest)
    camera = _camera(EYE, AT, settings.width, settings.height, ZOOM)
    inset = stage.goal(goal, settings.width // 4, settings.height // 4)
    parts = next((event.motion for event in cuts if event.motion), None)
    at_home = () if parts is None else _placed(parts, 0)

    def shown(now: Configuration, links: Sequence[tuple[Link, Pose]], words: str) -> Picture:
        return _labelled(stage.picture(camera, now, links), words, inset)

    stills = max(1, round(STILL * settings.rate))
    yield from [shown(start, at_home, "start")] * stills
    for event in cuts:
        if event.motion is None:
            yield from [shown(event.configuration, (), f"cut {event.step}")] * stills
            continue
        samples = round(_seconds(event.motion) / faster * settings.rate)
        times = event.motion.times[0] + np.arange(samples) * faster / settings.rate
        for sample in np.clip(np.searchsorted(event.motion.times, times), 0, len(event.motion.times) - 1):
            name, now = what_is_there(event.motion, int(sample))
            pace = "" if faster == 1.0 else f" ({faster:.1f} times as fast)"
            yield shown(now, _placed(event.motion, int(sample)), f"cut {event.step}: {name}{pace}")
        at_home = _placed(event.motion, -1)
    end = cuts[-1].configuration if cuts else start
    yield from [shown(end, at_home, "result")] * stills


def key_frames(
    start: Configuration,
    goal: Configuration,
    events: Sequence[Event],
    foods: Sequence[str] = (),
    most: int = 6,
    width: int = 320,
    height: int = 240,
) -> Picture:
    """One picture of a trial: the initial configuration, some of those on the way, the result, and the goal beside it.

    An arm is shown as it ends its press, the rest as what lies on the board. `most` is the number of pictures before
    the goal's.
    """
    stage = _Stage(start, foods)
    cuts = [event for event in events if isinstance(event, CutMade)]
    end = cuts[-1].configuration if cuts else start
    spread = np.unique(np.linspace(0, len(cuts) - 1, min(max(most - 2, 0), len(cuts))).round().astype(int))
    shown: list[tuple[str, Configuration, Sequence[tuple[Link, Pose]]]] = [("initial", start, ())]
    for cut in (cuts[i] for i in spread):
        if cut.motion is None:
            shown.append((f"cut {cut.step}", cut.configuration, ()))
        else:
            sample = _end_of_press(cut.motion)
            shown.append((f"cut {cut.step}", what_is_there(cut.motion, sample)[1], _placed(cut.motion, sample)))
    shown.append(("result", end, ()))
    camera = _close_camera([fragment for _, now, _ in shown for fragment in now], width, height)
    strip = [_labelled(stage.picture(camera, now, links), words) for words, now, links in shown]
    return np.concatenate([*strip, _labelled(stage.goal(goal, width, height), "goal")], axis=1)


def what_is_there(motion: Motion, sample: int) -> tuple[str, Configuration]:
    """The name of the phase that a sample of a motion belongs to, and the fragments where they are then."""
    phase = [phase for phase in motion.phases if phase.first <= sample][-1]
    if phase.poses is None:
        return phase.name, phase.fragments
    poses = phase.poses[min(sample - phase.first, len(phase.poses) - 1)]
    return phase.name, tuple(
        Fragment(fragment.shape, Pose.from_vector(numbers))
        for fragment, numbers in zip(phase.fragments, poses, strict=True)
    )


class _Stage:
    """The board, and the bodies of all that was ever on it or beside it."""

    def __init__(self, start: Configuration, foods: Sequence[str]) -> None:
        self._foods = tuple(foods) if len(foods) == len(start) else ("",) * len(start)
        self._last = start
        self._largest = largest_facet(start)
        # by the mesh's identity and what it is; the mesh is kept, so that its identity stays its own
        self._bodies: dict[tuple[int, str], tuple[Mesh, Body]] = {}

    @cached_property
    def _board(self) -> Body:
        x, y = BOARD
        corners = np.array([[i * x, j * y, k] for i in (-1, 1) for j in (-1, 1) for k in (TABLE_Z, 0.0)])
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
        return body_of(Mesh(corners, np.array(faces)), np.array(WOOD), 0.05)

    def picture(self, camera: Camera, now: Configuration, links: Sequence[tuple[Link, Pose]] = ()) -> Picture:
        """What `camera` sees of the fragments and the parts of a robot."""
        self._foods = foods_after(self._last, self._foods, now)
        self._last = now
        return paint(camera, [*self._fragments(now, self._foods), *((self._part(link), X) for link, X in links)])

    def goal(self, goal: Configuration, width: int, height: int) -> Picture:
        """The goal's fragments on a board of their own, where they are meshes."""
        solid = tuple(fragment for fragment in goal if isinstance(fragment.shape, Mesh))
        foods = foods_after(self._last, self._foods, solid)
        return paint(_close_camera(solid, width, height), self._fragments(solid, foods))

    def _fragments(self, now: Configuration, foods: Sequence[str]) -> list[tuple[Body, Pose]]:
        bodies = [(self._body(fragment.mesh, food), fragment.X_WF) for fragment, food in zip(now, foods, strict=True)]
        return [(self._board, Pose.identity()), *bodies]

    def _body(self, mesh: Mesh, food: str) -> Body:
        name = id(mesh), food
        if name not in self._bodies:
            self._bodies[name] = mesh, body_of(mesh, colours_of(mesh, food, self._largest), 0.25)
        return self._bodies[name][1]

    def _part(self, link: Link) -> Body:
        name = id(link.mesh), link.name
        if name not in self._bodies:
            colour, gloss = SHELL, 0.4
            if link.name in ("blade", "knife"):
                colour, gloss = METAL, 1.0
            elif "gripper" in link.name or link.name in ("handle", "base"):
                colour, gloss = DARK, 0.4
            self._bodies[name] = link.mesh, body_of(link.mesh, np.array(colour), gloss)
        return self._bodies[name][1]


def _seconds(motion: Motion | None) -> float:
    return STILL if motion is None else float(motion.times[-1] - motion.times[0])


def _placed(motion: Motion, sample: int) -> list[tuple[Link, Pose]]:
    return [(link, Pose.from_vector(motion.poses[sample, i])) for i, link in enumerate(motion.links)]


def _end_of_press(motion: Motion) -> int:
    """The last sample of the press, or of the whole where there is none."""
    starts = [phase.first for phase in motion.phases] + [len(motion.times)]
    ends = [starts[i + 1] - 1 for i, phase in enumerate(motion.phases) if phase.name == "press"]
    return ends[-1] if ends else len(motion.times) - 1


def _camera(eye: Floats, at: Floats, width: int, height: int, zoom: float = 1.0) -> Camera:
    return Camera(looking_at(eye, at), width, height, zoom * FOCAL * min(width, height * 4.0 / 3.0))


def _close_camera(framed: Sequence[Fragment], width: int, height: int) -> Camera:
    """A camera whose picture the fragments fill."""
    around = np.concatenate([np.zeros((0, 3)), *(f.X_WF.apply(f.mesh.vertices) for f in framed)])
    low, high = (around.min(axis=0), around.max(axis=0)) if len(around) else (np.zeros(3), np.zeros(3))
    middle, size = (low + high) / 2.0, float(np.linalg.norm(high - low))
    return _camera(middle + (0.15 + 1.0 * size) * TOWARDS_EYE, middle, width, height)


def _labelled(picture: Picture, words: str, inset: Picture | None = None) -> Picture:
    """The picture with words in its upper left corner, and another picture, "goal", in its upper right one."""
    paper = Pillow.fromarray(picture)
    pen = ImageDraw.Draw(paper)
    font = ImageFont.load_default(size=max(10, picture.shape[0] // 26))
    edge = max(4, picture.shape[0] // 60)
    pen.text((edge, edge), words, fill=INK, font=font, stroke_width=2, stroke_fill=HALO)
    if inset is not None:
        left = picture.shape[1] - inset.shape[1] - edge
        paper.paste(Pillow.fromarray(inset), (left, edge))
        pen.rectangle((left - 1, edge - 1, left + inset.shape[1], edge + inset.shape[0]), outline=(120, 124, 130))
        pen.text((left + edge, edge + 2), "goal", fill=INK, font=font, stroke_width=2, stroke_fill=HALO)
    return np.asarray(paper, dtype=np.uint8)
