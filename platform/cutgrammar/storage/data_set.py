"""The data set: a folder of demonstrations that anything can read and that tells when it is damaged.

`manifest.json` holds the schema version, what the set was made with, and the sha256 of every part; `trials/`,
`fragments/`, `poses/` and `cuts/` hold the parts as Parquet (`pandas.read_parquet(data / "cuts")` reads a whole table);
`splits/` says which trials train and which test. Which trials a part holds depends on their numbers alone.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from cutgrammar.atomic_files import atomic_folder
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.storage.manifest import Manifest, Part, place, read_manifest
from cutgrammar.storage.tables import (
    SCHEMAS,
    Tables,
    TrialSummary,
    demonstration_from,
    read_group,
    read_summaries,
    renumbered,
    tables_of,
    write_part,
)

TRIALS_A_PART = 50
"""A part holds the trials whose numbers agree when divided by this."""
T = TypeVar("T")


# --- writing ----------------------------------------------------------------------------------------------------------


def write_data_set(
    out: Path, demonstrations: Iterable[Demonstration], settings: DemonstratorSettings, seed: int
) -> None:
    """Write demonstrations, in ascending order of their trials, as a data set; equal ones give equal bytes.

    Args:
        out: the folder to make.
        demonstrations: read one by one; only those of one part are held at a time.
        settings: that they were made with.
        seed: that they were made from.

    Raises:
        InputError: `out` is in use.
        ValueError: no demonstrations, or trials out of order.
    """
    with new_data_set(out, settings, seed) as add:
        for demonstration in demonstrations:
            add(demonstration)


@contextmanager
def new_data_set(
    out: Path,
    settings: DemonstratorSettings,
    seed: int,
    foods: Mapping[str, str] | None = None,
    definition: str | None = None,
) -> Iterator[Callable[[Demonstration], None]]:
    """A data set that is filled in the block, trial after trial, and stands in `out` whole at its end.

    Args:
        out: the folder to make.
        settings: that its demonstrations are made with.
        seed: that they are made from.
        foods: name -> what stands behind it, so that the same request can be known again.
        definition: digest of what defines the demonstrator, for the same reason.

    Raises:
        InputError: `out` is in use.
        ValueError: no demonstrations, or trials out of order.
    """
    facts = Manifest(dataclasses.asdict(settings), seed, definition, dict(foods or {}), (), ())
    with _filling(out, facts) as add:
        yield lambda demonstration: add(tables_of(demonstration))


def merge(sets: Sequence["DataSet"], out: Path) -> None:
    """Write all trials of several data sets as one, numbered from 0 in the order given.

    Each trial keeps its seed and demonstrator; the manifest names the sources.

    Raises:
        InputError: `out` is in use, or a part cannot be read.
    """
    sources = tuple(
        {
            "digest": data.digest,
            "settings": data.settings,
            "seed": data.seed,
            "foods": data.foods,
            "trials": len(data.trials),
        }
        for data in sets
    )
    foods = {name: source for data in sets for name, source in data.foods.items()}
    with _filling(out, Manifest(None, None, None, foods, sources, ())) as add:
        rows = (data.tables(summary.trial) for data in sets for summary in data.trials)
        for trial, tables in enumerate(rows):
            add(renumbered(tables, trial))


@contextmanager
def _filling(out: Path, facts: Manifest) -> Iterator[Callable[[Tables], None]]:
    with atomic_folder(out) as folder:
        for table in SCHEMAS:
            (folder / table).mkdir()
        parts: list[Part] = []
        waiting: dict[int, Tables] = {}
        last = -1

        def flush() -> None:
            number = last // TRIALS_A_PART
            for table in SCHEMAS:
                write_part(folder / place(table, number), table, list(waiting.values()))
            parts.append(Part.of(folder, number, tuple(waiting)))
            waiting.clear()

        def add(tables: Tables) -> None:
            nonlocal last
            trial = int(tables["trials"]["trial"][0].as_py())
            if trial <= last:
                raise ValueError(f"trial {trial} came after trial {last}; ascending order was expected")
            if waiting and trial // TRIALS_A_PART != last // TRIALS_A_PART:
                flush()
            last = trial
            waiting[trial] = tables

        yield add
        if not waiting:
            raise ValueError("a data set has at least one demonstration")
        flush()
        dataclasses.replace(facts, parts=tuple(parts)).write(folder)


# --- reading ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DataSet:
    """A data set whose parts were checked against their digests.

    Attributes:
        path: its folder.
        digest: sha256 of its manifest, hence of everything in it but the splits.
        settings: what the demonstrator was set to, by name; None for a merged set.
        seed: what it was made from; None for a merged set.
        definition: digest of what defines its demonstrator, where there is one.
        foods: name of a food -> what stood behind it.
        sources: digests of the sets it was merged from.
        trials: the trials that can be read, ascending.
        missing: the numbers of those that cannot, where that was allowed.
    """

    path: Path
    digest: str
    settings: Mapping[str, Any] | None
    seed: int | None
    definition: str | None
    foods: Mapping[str, str]
    sources: tuple[str, ...]
    trials: tuple[TrialSummary, ...]
    missing: tuple[int, ...]
    _places: Mapping[int, tuple[TrialSummary, int, int]]  # trial -> summary, number of its part, row group within it

    @staticmethod
    def open(path: Path, allow_missing: bool = False) -> "DataSet":
        """Open the data set in folder `path`.

        Args:
            path: the folder.
            allow_missing: go on without the trials of parts that are missing or torn, and without foreign parts.

        Raises:
            InputError: no data set, another schema version, or a part that is missing, torn or foreign.
        """
        manifest, digest = read_manifest(path)
        missing: list[int] = []
        places: dict[int, tuple[TrialSummary, int, int]] = {}
        for part in manifest.parts:
            trouble = part.trouble(path)
            if trouble and not allow_missing:
                without = f"; train and evaluate go on without its {len(part.trials)} trials with --allow-missing"
                others = any(not other.trouble(path) for other in manifest.parts)
                raise InputError(
                    f"{path}: {trouble}; put the right one back{without if others else ', or collect again'}"
                )
            if trouble:
                missing += part.trials
            else:
                summaries = _summaries(path, part)
                places |= {s.trial: (s, part.number, group) for group, s in enumerate(summaries)}
        if not allow_missing:
            manifest.refuse_foreign(path)
        if not places:
            raise InputError(f"{path} has no trial that can be read; collect again")
        return DataSet(
            path=path,
            digest=digest,
            settings=manifest.settings,
            seed=manifest.seed,
            definition=manifest.definition,
            foods=manifest.foods,
            sources=tuple(source["digest"] for source in manifest.sources),
            trials=tuple(summary for summary, _, _ in places.values()),
            missing=tuple(missing),
            _places=places,
        )

    def summary(self, trial: int) -> TrialSummary:
        """What is known of a trial without its meshes.

        Raises:
            InputError: no such trial, or its part is missing.
        """
        return self._place(trial)[0]

    def demonstration(self, trial: int) -> Demonstration:
        """Read one demonstration.

        Raises:
            InputError: no such trial, or its part is missing or does not hold what it should.
        """
        summary, number, _ = self._place(trial)
        tables = self.tables(trial)
        return _readable(self.path, place("fragments", number), lambda: demonstration_from(summary, tables))

    def tables(self, trial: int) -> Tables:
        """The rows of one trial in every table.

        Raises:
            InputError: no such trial, or its part is missing or does not hold what it should.
        """
        _, number, group = self._place(trial)
        return {table: self._rows(table, number, group) for table in SCHEMAS}

    def _rows(self, table: str, number: int, group: int) -> Any:
        file = place(table, number)
        return _readable(self.path, file, lambda: read_group(self.path / file, table, group))

    def _place(self, trial: int) -> tuple[TrialSummary, int, int]:
        if trial in self.missing:
            raise InputError(f"{self.path}: trial {trial} stood in a part that is missing or torn")
        if trial not in self._places:
            raise InputError(
                f"{self.path} has no trial {trial}; its {len(self.trials)} trials are numbered"
                f" {self.trials[0].trial} to {self.trials[-1].trial}"
            )
        return self._places[trial]


def _summaries(path: Path, part: Part) -> list[TrialSummary]:
    file = place("trials", part.number)
    summaries = _readable(path, file, lambda: read_summaries(path / file))
    if tuple(summary.trial for summary in summaries) != part.trials:
        raise InputError(f"{path}: {file} holds other trials than the manifest says; collect again")
    return summaries


def _readable(path: Path, file: Path, read: Callable[[], T]) -> T:
    """What `read` returns; what a part does not let it read is the user's to know."""
    try:
        return read()
    except (OSError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            f"{path}: {file} cannot be used ({reason}); put the right one back, or collect again"
        ) from error
