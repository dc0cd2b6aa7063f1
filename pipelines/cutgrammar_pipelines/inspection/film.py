"""A trial as a film, and as stills, as the paper's figure 6."""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from cutgrammar.atomic_files import write_atomic
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.trials.goals import FOREIGN
from cutgrammar_dashboards.figures.layout.spread import apart, objects_of
from cutgrammar_dashboards.film.film_files import SUFFIXES, write_film
from cutgrammar_dashboards.film.frames import FilmSettings, film_frames
from cutgrammar_dashboards.film.stills import Still, on_one_sheet, stills
from cutgrammar_dashboards.rendering.scene import Pixels
from cutgrammar_pipelines.config import FilmConfig
from cutgrammar_pipelines.inspection.trial_trace import trace_trial
from cutgrammar_pipelines.stages.progress import Advance, progress

SMALL, LARGE = (640, 480), (1280, 960)
"""Width and height of stills on a sheet, two in a row, and in a folder [pixels]."""
MAX_PROCESSES = 8
"""That paint a film, on a machine with as many cores."""
IN_PLACE = 1e-6
"""A goal is in place if its fragments lie no farther than this from those of the demonstration [m]."""


def film(config: FilmConfig) -> int:
    """Write a trial as a film, as stills, or both.

    Raises:
        InputError: no run, no such trial, no cut was made in it, it cannot be reproduced, or a file name has the
            wrong suffix.
    """
    out, place = config.out, _place_of(config)
    for name, file, suffixes in (("--out", out, SUFFIXES), ("--stills", place, (".png", ""))):
        if file is not None and file.suffix not in suffixes:
            endings = ", ".join(filter(None, suffixes))
            folder = ", or of a folder" if "" in suffixes else ""
            raise InputError(f"{name} {file} cannot be written; give a name that ends in {endings}{folder}")
    trace, demonstration = trace_trial(config.run, config.trial, by_arm=False)
    name = trace.record.key.name
    is_foreign = trace.record.key.goals in FOREIGN
    goal = _spread_over_start(trace.goal, trace.start) if is_foreign else _spread_out(trace.goal, demonstration)
    foods = demonstration.foods
    if out is None and config.stills is None:
        out = Path(f"{name}.webp")
    if config.stills is not None:
        size = SMALL if place is None or place.suffix else LARGE
        shown = stills(trace.start, goal, trace.events, foods, *size)
        for file in _write_stills(shown, place or Path(f"{name}.png")):
            print(file)
    if out is not None:
        settings = FilmSettings(max_seconds=float(config.seconds))
        with progress("film", settings.n_frames(trace.events)) as advance:
            frames = film_frames(
                trace.start, goal, trace.events, foods, settings, min(os.cpu_count() or 1, MAX_PROCESSES)
            )
            _write(out, _counted(frames, advance), settings.rate)
        print(out)
    return 0


def _place_of(config: FilmConfig) -> Path | None:
    """Where stills go; None if it follows from the trial's name, or there are none."""
    return config.stills[0] if config.stills else None


def _write_stills(shown: Sequence[Still], place: Path) -> list[Path]:
    """Write stills as one PNG file or, one by one, into a folder; return the files."""
    if place.suffix:
        _write(place, [on_one_sheet(shown)], 1.0)
        return [place]
    files = [place / f"{number}-{one.name.replace(' ', '-')}.png" for number, one in enumerate(shown, start=1)]
    for file, one in zip(files, shown, strict=True):
        _write(file, [one.pixels], 1.0)
    return files


def _spread_out(goal: Configuration, demonstration: Demonstration) -> Configuration:
    """The goal with its fragments moved a little apart if it is in place, because there they touch."""
    objects = objects_of(demonstration, demonstration.steps)
    positions = np.array([fragment.p_WC for fragment in demonstration.goal])
    distances = [np.linalg.norm(positions - fragment.p_WC, axis=1) for fragment in goal]
    if max(map(min, distances)) > IN_PLACE:
        return goal
    return _moved_apart(goal, [objects[int(np.argmin(to_all))] for to_all in distances])


def _spread_over_start(goal: Configuration, start: Configuration) -> Configuration:
    """A foreign goal with its fragments moved a little apart, those of each donor from the object in whose place it is.

    Fragments that were scattered only lie a little farther apart then.
    """
    places = np.array([fragment.p_WC[:2] for fragment in start])
    nearest = [int(np.argmin(np.linalg.norm(places - fragment.p_WC[:2], axis=1))) for fragment in goal]
    return _moved_apart(goal, nearest)


def _moved_apart(goal: Configuration, groups: Sequence[int]) -> Configuration:
    shifts = apart(goal, groups, within=0.3, between=0.0)
    poses = [Pose(f.X_WF.rotation, f.X_WF.position + shift) for f, shift in zip(goal, shifts, strict=True)]
    return tuple(Fragment(fragment.shape, X_WF) for fragment, X_WF in zip(goal, poses, strict=True))


def _write(file: Path, frames: Iterable[Pixels], rate: float) -> None:
    """Write a film to a file that appears only when it is complete."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_name(f".{file.stem}.partial{file.suffix}")
    try:
        write_film(partial, frames, rate)
        write_atomic(file, partial.read_bytes())
    finally:
        partial.unlink(missing_ok=True)


def _counted(frames: Iterable[Pixels], advance: Advance) -> Iterator[Pixels]:
    for frame in frames:
        advance()
        yield frame
