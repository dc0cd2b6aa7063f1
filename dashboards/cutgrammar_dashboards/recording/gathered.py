"""Rows that wait for one another, so that a path has few chunks in a recording, each of which takes 2 kB by itself."""

from collections.abc import Callable
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar_dashboards.recording.writer import Moments, Writer


class Gathered:
    """Rows of numbers by path, until they are written.

    Args:
        writer: of the recording.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._rows: dict[str, list[tuple[Moments, Floats]]] = {}

    @property
    def paths(self) -> list[str]:
        """Those with rows that wait."""
        return list(self._rows)

    def add(self, path: str, moments: Moments, values: Floats) -> None:
        """Add rows of values (k, n), later than those of before."""
        self._rows.setdefault(path, []).append((moments, values))

    def write(self, path: str, columns: Callable[[Floats], Any]) -> None:
        """Write what waits for a path, as the columns that are made of all its values (k, n)."""
        if parts := self._rows.pop(path, None):
            moments = Moments(*(np.concatenate(column) for column in zip(*(m for m, _ in parts), strict=True)))
            self._writer.send(path, moments, columns(np.concatenate([values for _, values in parts])))
