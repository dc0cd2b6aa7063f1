"""The data set: a folder of demonstrations in standard formats, with checksums.

`manifest.json` contains the schema version, how the set was made, and the sha256 of every part. The folders `trials/`,
`fragments/`, `poses/` and `cuts/` contain the parts as Parquet (`pandas.read_parquet(data / "cuts")` reads a whole
table); demonstrations made by hand have a fifth table, `strokes/`. `splits/` defines which trials are for training and
testing. A trial's number determines its part.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa

from cutgrammar.atomic_files import atomic_folder
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.storage.demonstration_check import WrongRowsError
from cutgrammar.storage.manifest import Manifest, Part, part_path, read_manifest
from cutgrammar.storage.part_footers import DeadlyPartError, check_footers, trust_footer
from cutgrammar.storage.tables import (
    ALL_SCHEMAS,
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

TRIALS_PER_PART = 50
"""Trial t is in part t // `TRIALS_PER_PART`."""
T = TypeVar("T")


# --- writing ----------------------------------------------------------------------------------------------------------


def write_data_set(
    out: Path, demonstrations: Iterable[Demonstration], settings: DemonstratorSettings, seed: int
) -> None:
    """Write demonstrations as a data set; equal demonstrations give equal bytes.

    Args:
        out: the folder to create.
        demonstrations: in ascending order of their trials; only those of one part are in memory at a time.
        settings: the demonstrator's settings.
        seed: the seed that they were made from.

    Raises:
        InputError: `out` exists already.
        ValueError: there are no demonstrations, or the trials are not ascending.
    """
    with new_data_set(out, settings, seed) as add:
        for demonstration in demonstrations:
            add(demonstration)


@contextmanager
def new_data_set(
    out: Path,
    settings: DemonstratorSettings | None,
    seed: int | None,
    foods: Mapping[str, str] | None = None,
    definition: str | None = None,
) -> Iterator[Callable[[Demonstration | Tables], None]]:
    """A context in which a data set is filled trial by trial, with demonstrations or their rows.

    `out` appears when it is complete.

    Args:
        out: the folder to create.
        settings: the scripted demonstrator's settings; None if it did not make the demonstrations.
        seed: the seed that they are made from; None if there is none.
        foods: food name -> its source; kept so that a later request can be compared with this one.
        definition: digest of the demonstrator's definition, kept for the same purpose.

    Raises:
        InputError: `out` exists already.
        ValueError: there are no demonstrations, or the trials are not ascending.
    """
    facts = Manifest(
        None if settings is None else dataclasses.asdict(settings), seed, definition, dict(foods or {}), (), ()
    )
    with _writing(out, facts) as add:
        yield lambda trial: add(tables_of(trial) if isinstance(trial, Demonstration) else trial)


def merge(sets: Sequence["DataSet"], out: Path) -> None:
    """Merge data sets into one; the trials are numbered from 0 in the given order.

    Each trial keeps its seed and demonstrator; the manifest lists the sources.

    Raises:
        InputError: `out` exists already, or a part cannot be read.
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
    with _writing(out, Manifest(None, None, None, foods, sources, ())) as add:
        rows = (data.tables(summary.trial) for data in sets for summary in data.trials)
        for trial, tables in enumerate(rows):
            add(renumbered(tables, trial))


@contextmanager
def _writing(out: Path, facts: Manifest) -> Iterator[Callable[[Tables], None]]:
    with atomic_folder(out) as folder:
        for table in SCHEMAS:
            (folder / table).mkdir()
        parts: list[Part] = []
        pending: dict[int, Tables] = {}
        last = -1

        def flush() -> None:
            number = last // TRIALS_PER_PART
            parts.append(write_tables(folder, number, pending))
            pending.clear()

        def add(tables: Tables) -> None:
            nonlocal last
            trial = int(tables["trials"]["trial"][0].as_py())
            if trial <= last:
                raise ValueError(f"trial {trial} came after trial {last}; ascending order is required")
            if pending and trial // TRIALS_PER_PART != last // TRIALS_PER_PART:
                flush()
            last = trial
            pending[trial] = tables

        yield add
        if not pending:
            raise ValueError("a data set needs at least one demonstration")
        flush()
        dataclasses.replace(facts, parts=tuple(parts)).write(folder)


def write_tables(folder: Path, number: int, trials: Mapping[int, Tables]) -> Part:
    """Write part `number` with the rows of `trials`, by number, into all tables that they have rows in."""
    for table in ALL_SCHEMAS:
        if table in SCHEMAS or any(table in tables for tables in trials.values()):
            (folder / table).mkdir(exist_ok=True)
            write_part(folder / part_path(table, number), table, list(trials.values()))
    return Part.of(folder, number, tuple(trials))


# --- reading ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DataSet:
    """A data set whose parts have been checked against their digests.

    Attributes:
        path: its folder.
        digest: sha256 of its manifest, and thereby of its whole content except the splits.
        settings: the demonstrator's settings by name; None for a merged or imported set.
        seed: the seed that it was made from; None for a merged or imported set.
        definition: digest of the demonstrator's definition, or None.
        foods: food name -> its source.
        sources: digests of the sets it was merged from.
        trials: the readable trials, ascending.
        missing: numbers of trials in missing or damaged parts, if these were allowed.
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
    _places: Mapping[int, tuple[TrialSummary, Part, int]]  # trial -> summary, its part, row group

    @staticmethod
    def open(path: Path, allow_missing: bool = False, known: str | None = None) -> "DataSet":
        """Open the data set in folder `path`.

        Args:
            path: the folder.
            allow_missing: ignore missing, damaged and foreign parts.
            known: digest of a data set that another process of this program has opened, which need not find out again
                whether its parts can be read in safety.

        Raises:
            InputError: there is no data set, it has another schema version, or a part is missing, damaged or foreign.
        """
        manifest, digest = read_manifest(path)
        missing: list[int] = []
        sound: list[Part] = []
        for part in manifest.parts:
            problem = part.problem(path)
            if problem and not allow_missing:
                skip = f"; train and evaluate skip its {len(part.trials)} trials with --allow-missing"
                others = any(not other.problem(path) for other in manifest.parts)
                raise InputError(f"{path}: {problem}; restore it{skip if others else ', or collect again'}")
            if problem:
                missing += part.trials
            else:
                sound.append(part)
        _check_footers(path, sound, is_known=digest == known)
        places: dict[int, tuple[TrialSummary, Part, int]] = {}
        for part in sound:
            places |= {s.trial: (s, part, group) for group, s in enumerate(_summaries(path, part))}
        if not allow_missing:
            manifest.refuse_foreign(path)
        if not places:
            raise InputError(f"{path} has no readable trial; collect again")
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
        """The summary of a trial, without its meshes.

        Raises:
            InputError: there is no such trial, or its part is missing.
        """
        return self._locate(trial)[0]

    def demonstration(self, trial: int) -> Demonstration:
        """Read one demonstration.

        Raises:
            InputError: there is no such trial, or its part is missing or invalid.
        """
        summary, part, _ = self._locate(trial)
        tables = self.tables(trial)
        return _readable(self.path, part_path("fragments", part.number), lambda: demonstration_from(summary, tables))

    def tables(self, trial: int) -> Tables:
        """The rows of one trial in every table of its part.

        Raises:
            InputError: there is no such trial, or its part is missing or invalid.
        """
        _, part, group = self._locate(trial)
        tables = {table: self._rows(table, part.number, group) for table in part.sha256}
        return {table: rows for table, rows in tables.items() if table in SCHEMAS or rows.num_rows}

    def _rows(self, table: str, number: int, group: int) -> Any:
        file = part_path(table, number)
        return _readable(self.path, file, lambda: read_group(self.path / file, table, group))

    def _locate(self, trial: int) -> tuple[TrialSummary, Part, int]:
        if trial in self.missing:
            raise InputError(f"{self.path}: trial {trial} is in a part that is missing or damaged")
        if trial not in self._places:
            raise InputError(
                f"{self.path} has no trial {trial}; its {len(self.trials)} trials are numbered"
                f" {self.trials[0].trial} to {self.trials[-1].trial}"
            )
        return self._places[trial]


def _check_footers(path: Path, parts: Sequence[Part], is_known: bool) -> None:
    """Find out whether parts can be read in safety.

    Raises:
        InputError: one of them cannot.
    """
    files = [path / part_path(table, part.number) for part in parts for table in part.sha256]
    if is_known:
        for file in files:
            trust_footer(file)
        return
    try:
        check_footers(files)
    except DeadlyPartError as error:
        raise _unusable(path, error.path.relative_to(path), error) from None


def _summaries(path: Path, part: Part) -> list[TrialSummary]:
    file = part_path("trials", part.number)
    summaries = _readable(path, file, lambda: read_summaries(path / file))
    if tuple(summary.trial for summary in summaries) != part.trials:
        raise InputError(f"{path}: {file} has other trials than the manifest; collect again")
    return summaries


def _readable(path: Path, file: Path, read: Callable[[], T]) -> T:
    """Call `read` and turn its errors into an `InputError`."""
    try:
        return read()
    except (OSError, ValueError, pa.ArrowException) as error:
        if isinstance(error, WrongRowsError):
            file = Path(error.table, file.name)
        raise _unusable(path, file, error) from error


def _unusable(path: Path, file: Path, error: Exception) -> InputError:
    reason = (str(error) or type(error).__name__).splitlines()[0]
    return InputError(f"{path}: {file} cannot be used ({reason}); restore it, or collect again")
