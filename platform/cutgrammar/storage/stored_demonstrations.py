"""The demonstrations of a data set as a sequence of which one is in memory at a time."""

from collections.abc import Sequence
from typing import overload

from cutgrammar.demonstration import Demonstration
from cutgrammar.storage.data_set import DataSet


class StoredDemonstrations(Sequence[Demonstration]):
    """The demonstrations of some trials of a data set, each read when it is asked for.

    The last one is kept. What is sent to another process is where they are, so that it must see the same files.

    Args:
        source: the data set.
        trials: numbers of the trials.
    """

    def __init__(self, source: DataSet, trials: Sequence[int]) -> None:
        self._source, self._trials = source, tuple(trials)
        self._last: Demonstration | None = None

    def __reduce__(self) -> tuple[type["StoredDemonstrations"], tuple[DataSet, tuple[int, ...]]]:
        return StoredDemonstrations, (self._source, self._trials)

    def __len__(self) -> int:
        return len(self._trials)

    @overload
    def __getitem__(self, index: int) -> Demonstration: ...
    @overload
    def __getitem__(self, index: slice) -> "StoredDemonstrations": ...
    def __getitem__(self, index: int | slice) -> "Demonstration | StoredDemonstrations":
        """The demonstration at a position, or those of some positions.

        Raises:
            InputError: a part of the data set is missing or invalid.
        """
        if isinstance(index, slice):
            return StoredDemonstrations(self._source, self._trials[index])
        trial = self._trials[index]
        if self._last is None or self._last.trial != trial:
            self._last = self._source.demonstration(trial)
        return self._last
