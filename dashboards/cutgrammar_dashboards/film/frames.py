"""A trial as the frames of a film.

An arm is shown in motion; a cut by a world without an arm is shown as the configurations before and after it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cutgrammar.events import CutMade, Event
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.motion import Motion
from cutgrammar_dashboards.film.painters import in_turn
from cutgrammar_dashboards.film.stage import PlacedLink, Stage, camera_at
from cutgrammar_dashboards.rendering.scene import Pixels

POSITION, TARGET, ZOOM = np.array([0.62, -0.52, 0.48]), np.array([-0.05, 0.02, 0.10]), 1.05
"""Position of the film's camera and the middle of its view, in W [m], and its zoom."""
INK, HALO, FRAME = (40, 44, 50), (240, 242, 244), (120, 124, 130)
STILL_SECONDS = 1.0
"""How long the start, the result and a configuration that no arm made are shown [s]."""


@dataclass(frozen=True)
class FilmSettings:
    """How a film is made.

    Attributes:
        width, height: of the frames [pixels].
        rate: frames a second.
        max_seconds: if the motions last longer, the film is sped up to this [s].
    """

    width: int = 640
    height: int = 480
    rate: float = 15.0
    max_seconds: float = 30.0

    def speed_up(self, cuts: Sequence[CutMade]) -> float:
        """The factor by which these cuts are shown faster than they were."""
        return max(1.0, sum(_seconds(cut.motion) for cut in cuts) / self.max_seconds)

    def n_frames(self, events: Sequence[Event]) -> int:
        """Approximate number of frames of a film of these events."""
        cuts = cuts_in(events)
        motion = sum(_seconds(cut.motion) for cut in cuts) / self.speed_up(cuts)
        return round((motion + 2.0 * STILL_SECONDS) * self.rate)


@dataclass(frozen=True, eq=False)
class _Shot:
    """What one frame shows, and how often it is repeated."""

    now: Configuration
    links: Sequence[PlacedLink]
    text: str
    repeats: int = 1


def film_frames(
    start: Configuration,
    goal: Configuration,
    events: Sequence[Event],
    foods: Sequence[str] = (),
    settings: FilmSettings | None = None,
    processes: int = 1,
) -> Iterator[Pixels]:
    """The frames of a trial in their order, with the goal in a corner.

    Args:
        start: the initial configuration.
        goal: the goal's fragments; those that are clouds are not shown.
        events: of the trial; its cuts are shown, with their motions.
        foods: the name of each object's food in `start`; without, all have a neutral colour.
        settings: the defaults if None.
        processes: that paint, each every n-th frame; 1: this one alone. The frames are the same.

    Yields:
        (height, width, 3) frames, `settings.rate` a second.
    """
    settings = settings or FilmSettings()
    film = (start, goal, events, foods, settings)
    painted = _every(0, 1, *film) if processes == 1 else in_turn(processes, _every, film)
    for pixels, shot in zip(painted, _shots(start, events, settings), strict=True):
        yield from [pixels] * shot.repeats


def _every(
    first: int,
    among: int,
    start: Configuration,
    goal: Configuration,
    events: Sequence[Event],
    foods: Sequence[str],
    settings: FilmSettings,
) -> Iterator[Pixels]:
    """Every `among`-th shot from the `first` on, painted."""
    stage = Stage(start, foods)
    camera = camera_at(POSITION, TARGET, settings.width, settings.height, ZOOM)
    inset = stage.goal_picture(goal, settings.width // 4, settings.height // 4)
    for number, shot in enumerate(_shots(start, events, settings)):
        if number % among == first:
            yield captioned(stage.picture(camera, shot.now, shot.links), shot.text, inset)
        else:
            stage.follow(shot.now)


def _shots(start: Configuration, events: Sequence[Event], settings: FilmSettings) -> Iterator[_Shot]:
    cuts = cuts_in(events)
    speed_up = settings.speed_up(cuts)
    first_motion = next((cut.motion for cut in cuts if cut.motion), None)
    links = () if first_motion is None else tuple(links_at(first_motion, 0))
    n_still = max(1, round(STILL_SECONDS * settings.rate))
    yield _Shot(start, links, "start", n_still)
    for cut in cuts:
        if cut.motion is None:
            yield _Shot(cut.configuration, (), f"cut {cut.step}", n_still)
            continue
        recorded = cut.motion.times
        n_samples = round(_seconds(cut.motion) / speed_up * settings.rate)
        times = recorded[0] + np.arange(n_samples) * speed_up / settings.rate
        for sample in np.clip(np.searchsorted(recorded, times), 0, len(recorded) - 1).tolist():
            phase, now = fragments_at(cut.motion, sample)
            pace = "" if speed_up == 1.0 else f" ({speed_up:.1f} times as fast)"
            yield _Shot(now, links_at(cut.motion, sample), f"cut {cut.step}: {phase}{pace}")
        links = tuple(links_at(cut.motion, -1))
    yield _Shot(cuts[-1].configuration if cuts else start, links, "result", n_still)


def fragments_at(motion: Motion, sample: int) -> tuple[str, Configuration]:
    """The name of the phase to which a sample of a motion belongs, and the fragments in their poses at it."""
    phase = [phase for phase in motion.phases if phase.first <= sample][-1]
    if phase.poses is None:
        return phase.name, phase.fragments
    poses = phase.poses[min(sample - phase.first, len(phase.poses) - 1)]
    return phase.name, tuple(
        Fragment(fragment.shape, Pose.from_vector(numbers))
        for fragment, numbers in zip(phase.fragments, poses, strict=True)
    )


def links_at(motion: Motion, sample: int) -> list[PlacedLink]:
    """The robot's parts in their poses at a sample of a motion."""
    return [(link, Pose.from_vector(motion.poses[sample, i])) for i, link in enumerate(motion.links)]


def cuts_in(events: Sequence[Event]) -> list[CutMade]:
    """The cuts that were made."""
    return [event for event in events if isinstance(event, CutMade)]


def _seconds(motion: Motion | None) -> float:
    return STILL_SECONDS if motion is None else float(motion.times[-1] - motion.times[0])


def captioned(picture: Pixels, text: str, inset: Pixels | None = None) -> Pixels:
    """The picture with a text in its upper left corner and, in its upper right corner, a small picture of the goal."""
    image = Image.fromarray(picture)
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=max(10, picture.shape[0] // 26))
    edge = max(4, picture.shape[0] // 60)
    pen.text((edge, edge), text, fill=INK, font=font, stroke_width=2, stroke_fill=HALO)
    if inset is not None:
        left = picture.shape[1] - inset.shape[1] - edge
        image.paste(Image.fromarray(inset), (left, edge))
        pen.rectangle((left - 1, edge - 1, left + inset.shape[1], edge + inset.shape[0]), outline=FRAME)
        pen.text((left + edge, edge + 2), "goal", fill=INK, font=font, stroke_width=2, stroke_fill=HALO)
    return np.asarray(image, dtype=np.uint8)
