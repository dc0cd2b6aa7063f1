"""A trial as a film, and as key frames beside the goal, as the paper's figure 6."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from cutgrammar.atomic_files import write_atomic
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.events import CutMade, Event
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.figures.spread import apart, objects_of
from cutgrammar_pipelines.inspection.reproduce import told_again
from cutgrammar_pipelines.stages.progress import Advance, progress
from cutgrammar_sim.cameras.film import STILL, FilmSettings, film_frames, key_frames
from cutgrammar_sim.cameras.moving_pictures import SUFFIXES, write_film
from cutgrammar_sim.cameras.painting import Picture

IN_PLACE = 1e-6
"""How far the fragments of a goal in place may lie from where the demonstration has them [m]."""


def film(run: Path, trial: str, out: Path | None = None, stills: Path | None = None, seconds: int = 30) -> int:
    """Write what happened in a trial as a film, as key frames, or both.

    Args:
        run: a folder that `evaluate` made.
        trial: its name in the run, or a beginning of it that no other has.
        out: file of the film; None names it by the trial, or makes none where `stills` are asked for.
        stills: file of the key frames.
        seconds: how long the film lasts at the most.

    Raises:
        InputError: no run, no such trial, nothing was cut in it, it cannot be carried out again, or a file's name has
            another ending than those of pictures.
    """
    for name, file, endings in (("--out", out, SUFFIXES), ("--stills", stills, (".png",))):
        if file is not None and file.suffix not in endings:
            raise InputError(f"{name} {file} cannot be written; give a name that ends in {', '.join(endings)}")
    story, demonstration = told_again(run, trial, by_arm=False)
    goal, foods = _seen_apart(story.goal, demonstration), demonstration.foods
    if out is None and stills is None:
        out = Path(f"{story.record.key.name}.webp")
    if stills is not None:
        _write(stills, [key_frames(story.start, goal, story.events, foods)], 1.0)
        print(stills)
    if out is not None:
        settings = FilmSettings(longest=float(seconds))
        with progress("film", _pictures(story.events, settings)) as advance:
            frames = film_frames(story.start, goal, story.events, foods, settings)
            _write(out, _counted(frames, advance), settings.rate)
        print(out)
    return 0


def _seen_apart(goal: Configuration, demonstration: Demonstration) -> Configuration:
    """The goal with its fragments a little apart where they touch, as those of goals in place do."""
    objects, places = objects_of(demonstration, demonstration.steps), [f.p_WC for f in demonstration.goal]
    away = [np.linalg.norm(np.array(places) - fragment.p_WC, axis=1) for fragment in goal]
    if max(map(min, away)) > IN_PLACE:
        return goal
    shifts = apart(goal, [objects[int(np.argmin(one))] for one in away], within=0.3, between=0.0)
    poses = [Pose(f.X_WF.rotation, f.X_WF.position + shift) for f, shift in zip(goal, shifts, strict=True)]
    return tuple(Fragment(fragment.shape, X_WF) for fragment, X_WF in zip(goal, poses, strict=True))


def _write(file: Path, frames: Iterable[Picture], rate: float) -> None:
    """Write pictures to a file that is there whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    beside = file.with_name(f".{file.stem}.partial{file.suffix}")
    try:
        write_film(beside, frames, rate)
        write_atomic(file, beside.read_bytes())
    finally:
        beside.unlink(missing_ok=True)


def _counted(frames: Iterable[Picture], advance: Advance) -> Iterator[Picture]:
    for frame in frames:
        advance()
        yield frame


def _pictures(events: Iterable[Event], settings: FilmSettings) -> int:
    """About how many pictures there will be."""
    cuts = [event for event in events if isinstance(event, CutMade)]
    lasts = sum(STILL if event.motion is None else float(event.motion.times[-1]) for event in cuts)
    return round((min(lasts, settings.longest) + 2 * STILL) * settings.rate)
