"""A trial as stills: the initial configuration, some cuts, the result and the goal (as the paper's figure 6).

All are seen from one side: the one from which arm and blade hide least of the food while it is cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.events import Event
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.motion import Motion
from cutgrammar_dashboards.film.frames import captioned, cuts_in, fragments_at, links_at
from cutgrammar_dashboards.film.stage import BLADES, TOWARDS_CAMERA, PlacedLink, Stage, close_up
from cutgrammar_dashboards.rendering.scene import Pixels

AZIMUTHS = np.deg2rad(np.arange(0.0, 360.0, 22.5))
HEIGHT = 0.75
"""Height of the cameras that are tried over their horizontal distance: 37 degrees above the board."""
TRIED = (48, 36)
"""Width and height of the pictures by which cameras are compared [pixels]."""
PAPER = 250
"""Grey of the empty parts of a sheet."""


@dataclass(frozen=True, eq=False)
class Still:
    """One picture.

    Attributes:
        name: "initial", "cut 3", "result" or "goal".
        pixels: (height, width, 3).
    """

    name: str
    pixels: Pixels


@dataclass(frozen=True, eq=False)
class _Moment:
    """What a still shows, or leaves out: the fragments, and the parts of a robot."""

    name: str
    fragments: Configuration
    links: Sequence[PlacedLink] = ()
    is_shown: bool = True


def stills(
    start: Configuration,
    goal: Configuration,
    events: Sequence[Event],
    foods: Sequence[str] = (),
    width: int = 640,
    height: int = 480,
    max_cuts: int = 5,
) -> list[Still]:
    """The stills of a trial in their order, the goal last.

    Args:
        start: the initial configuration.
        goal: the goal's fragments; those that are clouds are not shown.
        events: of the trial. An arm is shown at the end of its press, with the blade in the food.
        foods: the name of each object's food in `start`; without, all have a neutral colour.
        width, height: of each [pixels].
        max_cuts: maximum number of cuts shown, spread evenly.
    """
    moments = _moments(start, events, max_cuts)
    shown = [one for one in moments if one.is_shown]
    towards = _clearest(start, shown)
    stage = Stage(start, foods)
    last = stage.goal_picture(goal, width, height, towards)  # first, while the stage knows the food of each object
    camera = close_up([fragment for one in shown for fragment in one.fragments], width, height, towards)
    pictures = []
    for one in moments:
        if one.is_shown:
            pictures.append(Still(one.name, captioned(stage.picture(camera, one.fragments, one.links), one.name)))
        else:
            stage.follow(one.fragments)
    return [*pictures, Still("goal", captioned(last, "goal"))]


def on_one_sheet(shown: Sequence[Still], columns: int = 2) -> Pixels:
    """Stills of one size in rows; result and goal are at the end of the last one."""
    pixels = [one.pixels for one in shown]
    empty = np.full_like(pixels[0], PAPER)
    pixels[-2:-2] = [empty] * (-len(pixels) % columns)
    rows = [np.concatenate(pixels[i : i + columns], axis=1) for i in range(0, len(pixels), columns)]
    return np.concatenate(rows)


def _moments(start: Configuration, events: Sequence[Event], max_cuts: int) -> list[_Moment]:
    cuts = cuts_in(events)
    chosen = np.unique(np.linspace(0, len(cuts) - 1, min(max_cuts, len(cuts))).round().astype(int))
    moments = [_Moment("initial", start)]
    for i, cut in enumerate(cuts):
        if cut.motion is None or i not in chosen:
            moments.append(_Moment(f"cut {cut.step}", cut.configuration, is_shown=i in chosen))
        else:
            sample = _end_of_press(cut.motion)
            moments.append(
                _Moment(f"cut {cut.step}", fragments_at(cut.motion, sample)[1], links_at(cut.motion, sample))
            )
    return [*moments, _Moment("result", cuts[-1].configuration if cuts else start)]


def _end_of_press(motion: Motion) -> int:
    """The last sample of the press or, without one, of the motion."""
    starts = [phase.first for phase in motion.phases] + [len(motion.times)]
    ends = [starts[i + 1] - 1 for i, phase in enumerate(motion.phases) if phase.name == "press"]
    return ends[-1] if ends else len(motion.times) - 1


def _clearest(start: Configuration, moments: Sequence[_Moment]) -> Floats:
    """(3,) direction in W from the fragments to the camera that sees most of food and blade.

    What a camera sees of the food is measured against the food without a robot, what it sees of the blade against what
    other cameras see of it. The smaller of both counts, so that neither is hidden for the sake of the other.
    """
    cut = [one for one in moments if one.links]
    if not cut:
        return TOWARDS_CAMERA
    stage = Stage(start, ())
    tried = [np.array([np.cos(angle), np.sin(angle), HEIGHT]) for angle in AZIMUTHS]
    worth = np.zeros(len(tried))
    for one in cut:
        is_blade = [link.name in BLADES for link, _ in one.links]
        food, blade = [], []
        for towards in tried:
            camera = close_up(one.fragments, *TRIED, towards)
            fragments, parts = stage.seen(camera, one.fragments, one.links)
            free, _ = stage.seen(camera, one.fragments, ())
            food.append(fragments.sum() / max(free.sum(), 1))
            blade.append(parts[is_blade].sum())
        worth += np.minimum(food, np.array(blade) / max(*blade, 1))
    return tried[int(np.argmax(worth.round(6)))]
