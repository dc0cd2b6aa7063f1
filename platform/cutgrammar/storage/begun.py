"""The trials of a data set that is being made, kept so that the same request continues after an interruption.

They lie in a hidden folder beside the data set to come, one folder a trial, which is complete or does not exist. The
folder is removed with the last trial.
"""

import fcntl
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from cutgrammar.atomic_files import atomic_folder
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.storage.data_set import write_tables
from cutgrammar.storage.manifest import Part, part_path
from cutgrammar.storage.tables import Tables, read_group, tables_of


class BegunDataSet:
    """The finished trials of a data set that is not finished.

    Args:
        folder: an existing folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def trials(self) -> frozenset[int]:
        """The trials that are kept."""
        return frozenset(int(path.name) for path in self._folder.iterdir() if path.name.isdigit())

    def keep(self, demonstration: Demonstration) -> Tables:
        """Keep a finished trial, of which the rows are returned; it survives a loss of power."""
        trial, tables = demonstration.trial, tables_of(demonstration)
        with atomic_folder(self._folder / str(trial)) as place:
            part = write_tables(place, 0, {trial: tables})
            (place / "part.json").write_text(json.dumps(asdict(part)))
        return tables

    def load(self, trial: int) -> Tables | None:
        """The rows of a trial that was kept; None, and it is forgotten, if files are damaged.

        They are not made a demonstration: that rounds poses, and the data set would have other bytes.
        """
        place = self._folder / str(trial)
        try:
            facts = json.loads((place / "part.json").read_text())
            part = Part(facts["number"], tuple(facts["trials"]), facts["sha256"])
            if part.trials == (trial,) and part.problem(place) is None:
                return {table: read_group(place / part_path(table, 0), table, 0) for table in part.sha256}
        except (OSError, ValueError, KeyError, TypeError):
            pass
        shutil.rmtree(place, ignore_errors=True)
        return None

    def clear(self) -> None:
        """Forget all trials."""
        for trial in self.trials():
            shutil.rmtree(self._folder / str(trial), ignore_errors=True)


@contextmanager
def begun_data_set(out: Path, request: str) -> Iterator[BegunDataSet]:
    """The trials of the data set `out` that are finished, for the length of a `with` block that makes the others.

    Args:
        out: folder of the data set to come.
        request: digest of all that determines it; another request begins anew.

    Raises:
        InputError: another process makes the same data set, or the place cannot be written.
    """
    folder = out.parent / f".{out.name}.begun-{request[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / "lock").open("w")
    except OSError as error:
        raise InputError(f"{out} cannot be made: {error.strerror}; choose another place with --out") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"another process is making {out}; wait for it, or choose another --out") from None
        begun = BegunDataSet(folder)
        try:
            yield begun
        except BaseException:
            if not begun.trials():
                shutil.rmtree(folder, ignore_errors=True)
            raise
        shutil.rmtree(folder, ignore_errors=True)
