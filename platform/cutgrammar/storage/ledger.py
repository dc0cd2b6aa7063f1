"""The ledger of a run: one row a trial in one SQLite file, which the driver alone writes.

Each record is written in a transaction of its own, synced to disk, together with the configurations of its trial: when
the driver dies, the ledger holds every trial that was reported done, once. The keys of all planned trials are
kept too, so that a reader can tell which are missing. Scores can be queried in SQL through the view `scores`.
"""

import fcntl
import gc
import hashlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from cutgrammar.errors import InputError
from cutgrammar.storage import attempts
from cutgrammar.storage.attempts import Attempt, AttemptSummary
from cutgrammar.storage.configurations import ROLES, TrialConfigurations, decode, encode
from cutgrammar.storage.foreign_sqlite import check_database, check_tables, guard
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar.trials.record_schema import check_key
from cutgrammar.untrusted import parse_json
from cutgrammar.untrusted.files import check_inside, open_lock

APPLICATION = 0x63757467
"""Marks the file as a ledger of cutgrammar ("cutg")."""
SCHEMA = 3
"""Version of the tables that are written."""
READABLE = (1, 2, 3)
"""Versions that can be read. Schema 1 had a column for each of two scores, and no configurations; schema 2 had no
attempts, which a ledger gets when it is opened for writing."""
TIMEOUT = 60.0
"""How long one process waits for another to release the file [s]."""
KEY = ("setup", "trial", "goals", "method", "run", "world", "perception", "origin")
RESULT = ("package", "render", "status", "reason", "fragments", "goal_fragments", "cuts")
TABLES = """
CREATE TABLE planned (key TEXT NOT NULL UNIQUE, setup TEXT NOT NULL, trial INTEGER NOT NULL, goals TEXT NOT NULL,
    method TEXT NOT NULL, run INTEGER NOT NULL, world TEXT NOT NULL, perception TEXT NOT NULL, origin TEXT NOT NULL);
CREATE TABLE records (key TEXT NOT NULL UNIQUE, setup TEXT NOT NULL, trial INTEGER NOT NULL, goals TEXT NOT NULL,
    method TEXT NOT NULL, run INTEGER NOT NULL, world TEXT NOT NULL, perception TEXT NOT NULL, origin TEXT NOT NULL,
    package TEXT NOT NULL, render TEXT, status TEXT NOT NULL, reason TEXT,
    fragments INTEGER, goal_fragments INTEGER NOT NULL, cuts INTEGER NOT NULL,
    record TEXT NOT NULL);
CREATE VIEW scores AS SELECT records.key, setup, trial, goals, method, run, world, perception,
    json_each.key AS score, json_each.value AS value FROM records, json_each(records.record, '$.scores');
CREATE TABLE configurations (key TEXT NOT NULL, role TEXT NOT NULL, digest TEXT NOT NULL, UNIQUE (key, role));
CREATE TABLE contents (digest TEXT NOT NULL UNIQUE, content BLOB NOT NULL);
"""
MIGRATION = f"BEGIN; {attempts.TABLES} {attempts.OF_EXISTING} PRAGMA user_version = {SCHEMA}; COMMIT;"
"""Makes a ledger of schema 2 one of schema 3."""

_OF_SCHEMA_1 = {"planned": ("key", *KEY), "records": ("key", *KEY, "record")}
_OF_SCHEMA_2 = {**_OF_SCHEMA_1, "configurations": ("key", "role", "digest"), "contents": ("digest", "content")}
COLUMNS = {1: _OF_SCHEMA_1, 2: _OF_SCHEMA_2, 3: {**_OF_SCHEMA_2, **attempts.COLUMNS}}
"""Schema -> table -> columns that are read."""

_WHOLE: set[tuple[str, int, int, int]] = set()
"""The files that this process has found whole: path, inode, bytes and time of the last change [ns]."""


class Ledger:
    """A ledger that is open for writing; only one driver can have it open."""

    def __init__(self, path: Path) -> None:
        """Open the ledger at `path`, or create it; one of schema 2 becomes one of schema 3.

        Raises:
            InputError: another driver has it open; the file is torn, not a ledger, or has another schema.
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
        """Close the file and release it for other drivers."""
        self._connection.close()
        self._lock.close()

    def plan(self, keys: Iterable[TrialKey]) -> None:
        """Add the keys of trials that are to be carried out."""
        rows = [(key.digest, *_values(key, KEY)) for key in keys]
        with _clear_errors(self.path), self._connection as transaction:
            transaction.executemany(f"INSERT OR IGNORE INTO planned VALUES ({_marks(1 + len(KEY))})", rows)

    def add(
        self,
        record: Record,
        configurations: TrialConfigurations | None = None,
        attempt: Attempt | None = None,
        replaces: bool = False,
    ) -> bool:
        """Write a record, the attempt that gave it, and the configurations of its trial, where they are known.

        Args:
            record: of the trial.
            configurations: of the trial.
            attempt: who carried it out, when, and with which versions.
            replaces: it takes the place of an existing record, which is kept with its attempt.

        Returns:
            False, and nothing is changed, if the ledger already has a record with this key.
        """
        digest = record.key.digest
        row = (
            digest,
            *_values(record.key, KEY),
            *_values(record, RESULT),
            json.dumps(record.to_json(), sort_keys=True, allow_nan=False),
        )
        contents = _contents(configurations)
        with _clear_errors(self.path), self._connection as transaction:
            if replaces:
                attempts.supersede(transaction, digest)
            done = transaction.execute(f"INSERT OR IGNORE INTO records VALUES ({_marks(len(row))})", row)
            if done.rowcount != 1:
                return False
            attempts.add_attempt(transaction, digest, record.status, record.reason, attempt or Attempt())
            for role, (content_digest, content) in contents.items():
                transaction.execute("INSERT OR IGNORE INTO contents VALUES (?, ?)", (content_digest, content))
                transaction.execute("INSERT INTO configurations VALUES (?, ?, ?)", (digest, role, content_digest))
        return True

    def add_fault(self, key: TrialKey, reason: str, attempt: Attempt) -> None:
        """Write an attempt that a fault of the machine ended; it gives no record."""
        with _clear_errors(self.path), self._connection as transaction:
            attempts.add_attempt(transaction, key.digest, attempts.FAULT, reason, attempt)

    def keys(self, statuses: Iterable[str] = ()) -> set[str]:
        """The digests of the keys of all records, or of those that ended with one of `statuses`."""
        chosen = tuple(statuses)
        where = f" WHERE status IN ({_marks(len(chosen))})" if chosen else ""
        with _clear_errors(self.path):
            return {key for (key,) in self._connection.execute(f"SELECT key FROM records{where}", chosen)}

    def attempts(self) -> AttemptSummary:
        """What the attempts so far come to."""
        with _clear_errors(self.path):
            return attempts.summary(self._connection)


def read_records(path: Path, events: bool = True, condensed: bool = False) -> list[Record]:
    """All records of the ledger at `path`, in the order of their keys, while a driver may be writing it.

    They are read as a stream: the text of one of them is in memory at a time.

    Args:
        path: of the ledger.
        events: read what happened in each trial, too, which is nearly all of a ledger; without it no record has events,
            and none has the digest that it has with them.
        condensed: keep only what reports need (see `Record.condensed`).

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    without = "CASE WHEN json_valid(record) THEN json_set(record, '$.events', json('[]')) ELSE record END"
    column = "record" if events else without
    records = []
    with _reading(path) as connection, _uncollected():
        for number, content in connection.execute(f"SELECT rowid, CAST({column} AS BLOB) FROM records"):
            try:
                record = Record.from_json(parse_json(content))
            except (TypeError, ValueError) as error:
                raise InputError(
                    f"ledger {path}: row {number} is not a record ({error}); put a good copy in place"
                ) from error
            records.append(record.condensed() if condensed else record)
    return sorted(records, key=lambda record: record.key)


def read_statuses(path: Path) -> dict[str, str]:
    """The digest of each record's key -> how its trial ended, without reading the records themselves.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        return dict(connection.execute("SELECT key, status FROM records"))


def read_planned(path: Path) -> list[TrialKey]:
    """The keys of all trials ever planned in the ledger at `path`, sorted, while a driver may be writing it.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        return sorted(TrialKey(*values) for values in _planned(connection, path))


def count_missing(path: Path) -> int:
    """The number of trials planned in the ledger at `path` that have no record, while a driver may be writing it.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        for _ in _planned(connection, path):
            pass
        query = "SELECT count(*) FROM planned WHERE key NOT IN (SELECT key FROM records)"
        return int(connection.execute(query).fetchone()[0])


def _planned(connection: sqlite3.Connection, path: Path) -> Iterator[tuple[Any, ...]]:
    """The checked fields of all planned keys.

    Raises:
        InputError: one of them is no key.
    """
    for number, *values in connection.execute(f"SELECT rowid, {', '.join(KEY)} FROM planned"):
        try:
            check_key(dict(zip(KEY, values, strict=True)))
        except ValueError as error:
            raise InputError(
                f"ledger {path}: row {number} of planned trials: {error}; put a good copy in place"
            ) from None
        yield tuple(values)


def read_configurations(path: Path, key: TrialKey) -> TrialConfigurations | None:
    """The configurations of a trial: None where they are not known, or the ledger has schema 1.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    return read_known_configurations(path, [key]).get(key)


def read_known_configurations(path: Path, keys: Iterable[TrialKey]) -> dict[TrialKey, TrialConfigurations]:
    """The configurations of those of the trials `keys` for which they are known; none in a ledger of schema 1.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        if _pragma(connection, "user_version") == 1:
            return {}
        query = "SELECT role, content FROM configurations JOIN contents USING (digest) WHERE key = ?"
        found = {key: dict(connection.execute(query, (key.digest,)).fetchall()) for key in keys}
    known = {}
    for key, contents in found.items():
        try:
            if contents:
                known[key] = TrialConfigurations(**{role: decode(_bytes(contents[role])) for role in ROLES})
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"ledger {path}: the configurations of {key.name} are torn ({error})") from error
    return known


def keys_with_configurations(path: Path) -> set[str]:
    """The digests of the keys of all trials whose configurations are known; none in a ledger of schema 1.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        if _pragma(connection, "user_version") == 1:
            return set()
        return {key for (key,) in connection.execute("SELECT DISTINCT key FROM configurations")}


@contextmanager
def _uncollected() -> Iterator[None]:
    """Within the block nothing looks for cycles: records have none, and looking takes half of the time to read many."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _bytes(value: object) -> bytes:
    if not isinstance(value, bytes):
        raise TypeError(f"it is of the type {type(value).__name__}")
    return value


def read_attempts(path: Path) -> AttemptSummary:
    """What the attempts of the ledger at `path` come to, while a driver may be writing it.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with _reading(path) as connection:
        return attempts.summary(connection) if _pragma(connection, "user_version") >= 3 else AttemptSummary((), {})


def _contents(configurations: TrialConfigurations | None) -> dict[str, tuple[str, bytes]]:
    """Role -> digest and content, of all roles or none."""
    encoded = {role: encode(getattr(configurations, role)) for role in ROLES} if configurations else {}
    known = {role: content for role, content in encoded.items() if content is not None}
    if len(known) < len(ROLES):
        return {}
    return {role: (hashlib.sha256(content).hexdigest(), content) for role, content in known.items()}


def _locked(path: Path) -> IO[Any]:
    """A lock file beside the ledger; the system releases it when this process ends."""
    lock = open_lock(path.with_suffix(".lock"))
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        raise InputError(
            f"{path.parent} is being evaluated by another process; wait for it, or choose another --out"
        ) from None
    return lock


def _connect(path: Path) -> sqlite3.Connection:
    check_inside(path.resolve(), path.parent)
    if path.exists():
        check_database(path, f"there is no ledger {path}")
    with _clear_errors(path):
        connection = sqlite3.connect(path, timeout=TIMEOUT)
        try:
            guard(connection)
            connection.execute("PRAGMA synchronous = EXTRA")
            empty = not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            if empty and not _pragma(connection, "application_id"):
                connection.executescript(
                    f"BEGIN; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {SCHEMA}; "
                    f"{TABLES} {attempts.TABLES} COMMIT;"
                )
            elif _pragma(connection, "application_id") == APPLICATION and _pragma(connection, "user_version") == 2:
                _check(connection, path, (2,))
                connection.executescript(MIGRATION)
            _check(connection, path, (SCHEMA,))
        except BaseException:
            connection.close()
            raise
        return connection


@contextmanager
def _reading(path: Path) -> Iterator[sqlite3.Connection]:
    check_database(path, f"there is no ledger {path}; cutgrammar evaluate creates one")
    # An unfinished transaction of a driver that died is rolled back by the next process that opens it for writing.
    mode = "rw" if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK) else "ro"
    with _clear_errors(path):
        connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode={mode}", timeout=TIMEOUT, uri=True)
        try:
            guard(connection)
            _check(connection, path, READABLE)
            yield connection
        finally:
            connection.close()


def _check(connection: sqlite3.Connection, path: Path, schemas: tuple[int, ...]) -> None:
    if _pragma(connection, "application_id") != APPLICATION:
        raise InputError(f"{path} is not a ledger of cutgrammar; choose another run folder")
    if (schema := _pragma(connection, "user_version")) not in schemas:
        use = "it can be read, but not resumed" if schema in READABLE else "it is of another version"
        raise InputError(f"ledger {path} has schema {schema}, not {SCHEMA}: {use}; evaluate into a new folder")
    check_tables(connection, path, COLUMNS[schema])
    facts = path.stat()
    version = (str(path.resolve()), facts.st_ino, facts.st_size, facts.st_mtime_ns)
    if version in _WHOLE:
        return
    (state,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if state != "ok":
        raise InputError(f"ledger {path} is torn ({state.splitlines()[0]}); put a good copy in its place")
    _WHOLE.add(version)


@contextmanager
def _clear_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):  # a full disk, a folder that may not be written
            raise OSError(f"ledger {path} cannot be used: {error}") from error
        raise InputError(f"ledger {path} is torn or foreign ({error}); put a good copy in its place") from error
    except UnicodeDecodeError as error:  # sqlite3 cannot even say what is wrong
        raise InputError(f"ledger {path} is torn or foreign (its schema is no text); put in a good copy") from error


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])


def _values(thing: object, names: tuple[str, ...]) -> tuple[Any, ...]:
    return tuple(getattr(thing, name) for name in names)


def _marks(number: int) -> str:
    return ", ".join("?" * number)
