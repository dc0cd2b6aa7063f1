"""Where a recording is written: a file, or a viewer that shows many trials at once.

A file has three timelines: `step`, the number of cuts made; `round`, which advances with every round of search and
every event, so that refused cuts and the search itself can be played back; and `time`, the simulated seconds of all
motions, in which every other event takes a second, so that it plays as a film.
"""

from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import rerun as rr

from cutgrammar.atomic_files import put_in_place
from cutgrammar.geometry.arrays import Floats

APPLICATION = "cutgrammar"
HOLD_TICKS = 8
"""Ticks of `round` for which a planned cut is shown before its outcome, so that it can be seen in playback."""
PAUSE = 1.0
"""How much of `time` an event takes that is not a motion [s]."""


class Moments(NamedTuple):
    """Positions of n rows on the timelines.

    Attributes:
        seconds, steps, rounds: (n,) each.
    """

    seconds: Floats
    steps: Floats
    rounds: Floats


class Writer(Protocol):
    """Takes what a recorder shows.

    Attributes:
        step, round, seconds: the current position on the timelines.
    """

    step: int
    round: int
    seconds: float

    def log(self, path: str, *components: Any, static: bool = False) -> None:
        """Log at the current time, or, if `static`, for all times."""
        ...

    def send(self, path: str, moments: Moments, columns: Any) -> None:
        """Log many rows with times of their own."""
        ...

    def move_to(self, step: int | None = None, round_: int | None = None, seconds: float | None = None) -> None:
        """Set the current position on those timelines that are given."""
        ...

    def tick(self, ticks: int = 1) -> None:
        """Advance `round` by `ticks`, and `time` by a pause."""
        ...

    def moments(self, seconds: Floats) -> Moments:
        """Those of rows at `seconds` (n,) of `time`, within the current step and round."""
        ...


class FileWriter:
    """Writes to a file beside `path` and renames it when it is complete.

    Attributes:
        path: of the complete file.
        step, round, seconds: the current position on the timelines.
    """

    def __init__(self, path: Path, title: str, recording_id: str) -> None:
        self.path = path
        self.step, self.round, self.seconds = 0, 0, 0.0
        self._partial = path.with_name(path.name + ".partial")
        path.parent.mkdir(parents=True, exist_ok=True)
        # A chunk takes about 2 kB by itself: rows wait for one another, so that few, large chunks are written.
        batching = rr.ChunkBatcherConfig(flush_tick=600.0)
        self._stream: Any = rr.RecordingStream(APPLICATION, recording_id=recording_id, batcher_config=batching)
        self._stream.set_log_time_enabled(False)  # the date of a recording is no part of what it shows
        self._stream.send_recording_name(title)
        self._set_time()

    def log(self, path: str, *components: Any, static: bool = False) -> None:
        """Log at the current time, or, if `static`, for all times."""
        self._stream.log(path, *components, static=static, strict=True)

    def send(self, path: str, moments: Moments, columns: Any) -> None:
        """Log many rows with times of their own."""
        indexes = [
            rr.TimeColumn("time", duration=moments.seconds),
            rr.TimeColumn("step", sequence=moments.steps.astype(np.int64)),
            rr.TimeColumn("round", sequence=moments.rounds.astype(np.int64)),
        ]
        self._stream.send_columns(path, indexes=indexes, columns=columns)

    def tick(self, ticks: int = 1) -> None:
        """Advance `round` by `ticks`, and `time` by a pause."""
        self.move_to(round_=self.round + ticks, seconds=self.seconds + PAUSE)

    def move_to(self, step: int | None = None, round_: int | None = None, seconds: float | None = None) -> None:
        """Set the current position on those timelines that are given."""
        self.step = self.step if step is None else step
        self.round = self.round if round_ is None else round_
        self.seconds = self.seconds if seconds is None else seconds
        self._set_time()

    def moments(self, seconds: Floats) -> Moments:
        """Those of rows at `seconds` (n,) of `time`, within the current step and round."""
        return Moments(seconds, np.full(len(seconds), float(self.step)), np.full(len(seconds), float(self.round)))

    def close(self, default_blueprint: Any) -> None:
        """Complete the file, which opens with this blueprint, and rename it to `path`."""
        # The blueprint depends on all that was recorded; until here rerun has kept the rows in memory.
        # A footer lists every chunk by every column, a quarter of the file, for random access that viewers do not need.
        self._stream.save(self._partial, default_blueprint=default_blueprint, write_footer=False)
        self._stream.flush()
        self._stream.disconnect()
        put_in_place(self._partial, self.path)

    def _set_time(self) -> None:
        self._stream.set_time("step", sequence=self.step)
        self._stream.set_time("round", sequence=self.round)
        self._stream.set_time("time", duration=self.seconds)
