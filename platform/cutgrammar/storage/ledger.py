"""The ledger: the truth about a run, one row a trial, in one SQLite file that the driver alone writes.

A row is written in a transaction of its own, synced to disk: after the death of the driver at any time the ledger holds
every trial that was reported done, each once. What was planned is kept beside what is there, so that a reader can tell
what is missing.
"""

import fcntl
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from cutgrammar.errors import InputError
from cutgrammar.trials.record import Record, TrialKey

APPLICATION = 0x63757467
"""Marks the file as ours ("cutg")."""
SCHEMA = 1
"""Version of the tables; another one is refused."""
PATIENCE = 60.0
"""How long one process waits for another to let go of the file [s]."""
KEY = ("setup", "trial", "goals", "method", "run", "world", "perception", "origin")
RESULT = ("package", "render", "status", "reason", "iou", "iou_strict", "fragments", "goal_fragments", "cuts")
TABLES = """
CREATE TABLE planned (key TEXT NOT NULL UNIQUE, setup TEXT NOT NULL, trial INTEGER NOT NULL, goals TEXT NOT NULL,
    method TEXT NOT NULL, run INTEGER NOT NULL, world TEXT NOT NULL, perception TEXT NOT NULL, origin TEXT NOT NULL);
CREATE TABLE records (key TEXT NOT NULL UNIQUE, setup TEXT NOT NULL, trial INTEGER NOT NULL, goals TEXT NOT NULL,
    method TEXT NOT NULL, run INTEGER NOT NULL, world TEXT NOT NULL, perception TEXT NOT NULL, origin TEXT NOT NULL,
    package TEXT NOT NULL, render TEXT, status TEXT NOT NULL, reason TEXT, iou REAL, iou_strict REAL NOT NULL,
    fragments INTEGER, goal_fragments INTEGER NOT NULL, cuts INTEGER NOT NULL,
    record TEXT NOT NULL);
"""


class Ledger:
    """A ledger opened for writing, by one driver at a time."""

    def __init__(self, path: Path) -> None:
        """Open the ledger at `path`, or make it.

        Raises:
            InputError: another driver has it open, or the file is torn or not a ledger.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._lock = _locked(path)
        try:
            self._connection = _connect(path)
        except BaseException:
            self._lock.close()
            raise

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let others write."""
        self._connection.close()
        self._lock.close()

    def plan(self, keys: Iterable[TrialKey]) -> None:
        """Note that these trials are to be there; those noted before stay."""
        rows = [(key.digest, *_values(key, KEY)) for key in keys]
        with _clear_errors(self.path), self._connection as transaction:
            transaction.executemany(f"INSERT OR IGNORE INTO planned VALUES ({_marks(1 + len(KEY))})", rows)

    def add(self, record: Record) -> bool:
        """Write a record for good; False, and nothing is changed, if the ledger has one of this key."""
        row = (
            record.key.digest,
            *_values(record.key, KEY),
            *_values(record, RESULT),
            json.dumps(record.to_json(), sort_keys=True, allow_nan=False),
        )
        with _clear_errors(self.path), self._connection as transaction:
            done = transaction.execute(f"INSERT OR IGNORE INTO records VALUES ({_marks(len(row))})", row)
        return done.rowcount == 1

    def keys(self) -> set[str]:
        """Digests of the keys of all records."""
        with _clear_errors(self.path):
            return {key for (key,) in self._connection.execute("SELECT key FROM records")}


def read_records(path: Path) -> list[Record]:
    """All records of the ledger at `path`, in the order of their keys; it may be in use.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        rows = connection.execute("SELECT record FROM records").fetchall()
    try:
        records = [Record.from_json(json.loads(text)) for (text,) in rows]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"ledger {path} holds a row that is not a record ({error}); put a good copy in place"
        ) from error
    return sorted(records, key=lambda record: record.key)


def read_planned(path: Path) -> list[TrialKey]:
    """The keys of all trials ever planned in the ledger at `path`, sorted; it may be in use.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        rows = connection.execute(f"SELECT {', '.join(KEY)} FROM planned").fetchall()
    return sorted(TrialKey(*row) for row in rows)


def _locked(path: Path) -> IO[Any]:
    """A lock beside the ledger, which the system lets go of when this process ends, however it ends."""
    lock = open(path.with_suffix(".lock"), "a")  # noqa: SIM115  (held until the ledger is closed)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        raise InputError(
            f"{path.parent} is being evaluated by another process; wait for it, or choose another --out"
        ) from None
    return lock


def _connect(path: Path) -> sqlite3.Connection:
    with _clear_errors(path):
        connection = sqlite3.connect(path, timeout=PATIENCE)
        try:
            connection.execute("PRAGMA synchronous = EXTRA")
            empty = not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            if empty and not _pragma(connection, "application_id"):
                connection.executescript(
                    f"BEGIN; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {SCHEMA}; {TABLES} COMMIT;"
                )
            _check(connection, path)
        except BaseException:
            connection.close()
            raise
        return connection


@contextmanager
def _reading(path: Path) -> Iterator[sqlite3.Connection]:
    if not path.is_file():
        raise InputError(f"there is no ledger {path}; cutgrammar evaluate makes one")
    # An unfinished transaction of a driver that died is rolled back by the next one to open the file for writing.
    mode = "rw" if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK) else "ro"
    with _clear_errors(path):
        connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode={mode}", timeout=PATIENCE, uri=True)
        try:
            _check(connection, path)
            yield connection
        finally:
            connection.close()


def _check(connection: sqlite3.Connection, path: Path) -> None:
    if _pragma(connection, "application_id") != APPLICATION:
        raise InputError(f"{path} is not a ledger of cutgrammar; choose another run folder")
    if (schema := _pragma(connection, "user_version")) != SCHEMA:
        raise InputError(f"ledger {path} has schema version {schema}, not {SCHEMA}; evaluate into a new folder")
    (state,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if state != "ok":
        raise InputError(f"ledger {path} is torn ({state.splitlines()[0]}); put a good copy in its place")


@contextmanager
def _clear_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):  # a full disk, a folder that may not be written
            raise OSError(f"ledger {path} cannot be used: {error}") from error
        raise InputError(f"ledger {path} is torn or foreign ({error}); put a good copy in its place") from error


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])


def _values(thing: object, names: tuple[str, ...]) -> tuple[Any, ...]:
    return tuple(getattr(thing, name) for name in names)


def _marks(number: int) -> str:
    return ", ".join("?" * number)
