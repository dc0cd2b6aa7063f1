"""A writer that shows one world among many in a viewer, on the timeline `elapsed`: seconds since the run began."""

from typing import Any

import numpy as np
import rerun as rr

from cutgrammar.geometry.arrays import Floats
from cutgrammar_dashboards.recording.writer import PAUSE, Moments

ELAPSED = "elapsed"


class LiveWriter:
    """Writes below a path of its own; what takes simulated time is spread over the real time that it took.

    Args:
        stream: to the viewer.
        root: the path.

    Attributes:
        step, round, seconds: as in `Writer`; here they only order what one event shows.
    """

    def __init__(self, stream: rr.RecordingStream, root: str) -> None:
        self._stream, self._root = stream, root
        self.step, self.round, self.seconds = 0, 0, 0.0
        self._began = self._ended = 0.0
        self._first, self._length = 0.0, PAUSE
        self._static: set[str] = set()

    def spread(self, began: float, ended: float, length: float) -> None:
        """What is shown from now on, `length` of simulated seconds, happened between these `elapsed` times [s]."""
        self._began, self._ended = began, ended
        self._first, self._length = self.seconds, length
        self._set_time()

    def log(self, path: str, *components: Any, static: bool = False) -> None:
        """Log at the current time, or, if `static`, for all times, which is done once for a path."""
        if static and path in self._static:
            return
        if static:
            self._static.add(path)
        self._stream.log(self._path(path), *components, static=static)

    def send(self, path: str, moments: Moments, columns: Any) -> None:
        """Log many rows with times of their own."""
        indexes = [rr.TimeColumn(ELAPSED, duration=self._elapsed(moments.seconds))]
        self._stream.send_columns(self._path(path), indexes=indexes, columns=columns)

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
        """Those of rows at `seconds` (n,) of `time`."""
        return Moments(seconds, np.full(len(seconds), float(self.step)), np.full(len(seconds), float(self.round)))

    def _path(self, path: str) -> str:
        return f"{self._root}/{path}" if path else self._root

    def _elapsed(self, seconds: Floats) -> Floats:
        share = np.clip((np.asarray(seconds) - self._first) / self._length, 0.0, 1.0)
        return np.asarray(self._began + share * (self._ended - self._began))

    def _set_time(self) -> None:
        self._stream.set_time(ELAPSED, duration=float(self._elapsed(np.array(self.seconds))))
