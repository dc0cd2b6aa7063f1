"""The file of one recording: its stream, its timelines and its texts.

Three timelines: `step`, the number of cuts made; `round`, which advances with every round of search and every event, so
that refused cuts and the search itself can be played back; and `time`, the simulated seconds of all motions, in which
every other event takes a second, so that it plays as a film.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun as rr

from cutgrammar.atomic_files import put_in_place
from cutgrammar.geometry.arrays import Floats
from cutgrammar_dashboards.recording import blueprint

APPLICATION = "cutgrammar"
HOLD_TICKS = 8
"""Ticks of `round` for which a planned cut is shown before its outcome, so that it can be seen in playback."""
PAUSE = 1.0
"""How much of `time` an event takes that is not a motion [s]."""


class Writer:
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
        self.stream: Any = rr.RecordingStream(APPLICATION, recording_id=recording_id, batcher_config=batching)
        self.stream.send_recording_name(title)
        self._set_time()

    def log(self, path: str, *components: Any, static: bool = False) -> None:
        """Log at the current time, or, if `static`, for all times."""
        self.stream.log(path, *components, static=static, strict=True)

    def send(self, path: str, indexes: Sequence[Any], columns: Any) -> None:
        """Log many rows with times of their own."""
        self.stream.send_columns(path, indexes=indexes, columns=columns)

    def say(self, level: str, text: str) -> None:
        """Add a line to the text log."""
        self.log(blueprint.LOG, rr.TextLog(text, level=level))

    def tick(self, ticks: int = 1) -> None:
        """Advance `round` by `ticks`, and `time` by a pause."""
        self.move_to(round_=self.round + ticks, seconds=self.seconds + PAUSE)

    def move_to(self, step: int | None = None, round_: int | None = None, seconds: float | None = None) -> None:
        """Set the current position on those timelines that are given."""
        self.step = self.step if step is None else step
        self.round = self.round if round_ is None else round_
        self.seconds = self.seconds if seconds is None else seconds
        self._set_time()

    def clock(self, seconds: Floats) -> list[Any]:
        """The time columns of rows at `seconds` (n,) of `time`, within the current step and round."""
        return [
            rr.TimeColumn("time", duration=seconds),
            rr.TimeColumn("step", sequence=[self.step] * len(seconds)),
            rr.TimeColumn("round", sequence=[self.round] * len(seconds)),
        ]

    def close(self, default_blueprint: Any) -> None:
        """Complete the file, which opens with this blueprint, and rename it to `path`."""
        # The blueprint depends on all that was recorded; until here rerun has kept the rows in memory.
        self.stream.save(self._partial, default_blueprint=default_blueprint)
        self.stream.flush()
        self.stream.disconnect()
        put_in_place(self._partial, self.path)

    def _set_time(self) -> None:
        self.stream.set_time("step", sequence=self.step)
        self.stream.set_time("round", sequence=self.round)
        self.stream.set_time("time", duration=self.seconds)
