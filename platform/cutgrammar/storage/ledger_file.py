"""The SQLite file of a ledger: its tables and their versions, its lock, and opening it for writing or reading."""

import fcntl
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from cutgrammar.errors import InputError
from cutgrammar.storage import attempts
from cutgrammar.storage.foreign_sqlite import check_database, check_tables, guard
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


def locked(path: Path) -> IO[Any]:
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


def connect(path: Path) -> sqlite3.Connection:
    """A connection for writing; the file is created, or gets the tables of today.

    Raises:
        InputError: it is torn, not a ledger, or has another schema.
        OSError: it cannot be written.
    """
    check_inside(path.resolve(), path.parent)
    if path.exists():
        check_database(path, f"there is no ledger {path}")
    with clear_errors(path):
        connection = sqlite3.connect(path, timeout=TIMEOUT)
        try:
            guard(connection)
            connection.execute("PRAGMA synchronous = EXTRA")
            empty = not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            if empty and not pragma(connection, "application_id"):
                connection.executescript(
                    f"BEGIN; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {SCHEMA}; "
                    f"{TABLES} {attempts.TABLES} COMMIT;"
                )
            elif pragma(connection, "application_id") == APPLICATION and pragma(connection, "user_version") == 2:
                _check(connection, path, (2,))
                connection.executescript(MIGRATION)
            _check(connection, path, (SCHEMA,))
        except BaseException:
            connection.close()
            raise
        return connection


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection for reading, while a driver may be writing.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    check_database(path, f"there is no ledger {path}; cutgrammar evaluate creates one")
    # An unfinished transaction of a driver that died is rolled back by the next process that opens it for writing.
    mode = "rw" if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK) else "ro"
    with clear_errors(path):
        connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode={mode}", timeout=TIMEOUT, uri=True)
        try:
            guard(connection)
            _check(connection, path, READABLE)
            yield connection
        finally:
            connection.close()


def _check(connection: sqlite3.Connection, path: Path, schemas: tuple[int, ...]) -> None:
    if pragma(connection, "application_id") != APPLICATION:
        raise InputError(f"{path} is not a ledger of cutgrammar; choose another run folder")
    if (schema := pragma(connection, "user_version")) not in schemas:
        use = "it can be read, but not resumed" if schema in READABLE else "it is of another version"
        raise InputError(f"ledger {path} has schema {schema}, not {SCHEMA}: {use}; evaluate into a new folder")
    check_tables(connection, path, COLUMNS[schema])
    if _version(path) in _WHOLE:
        return
    (state,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if state != "ok":
        raise InputError(f"ledger {path} is torn ({state.splitlines()[0]}); put a good copy in its place")
    note_whole(path)


def note_whole(path: Path) -> None:
    """This process has read every page of a ledger, or has written all that changed since."""
    _WHOLE.add(_version(path))


def _version(path: Path) -> tuple[str, int, int, int]:
    facts = path.stat()
    return str(path.resolve()), facts.st_ino, facts.st_size, facts.st_mtime_ns


@contextmanager
def clear_errors(path: Path) -> Iterator[None]:
    """Raise what SQLite reports within the block as errors that name the ledger."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):  # a full disk, a folder that may not be written
            raise OSError(f"ledger {path} cannot be used: {error}") from error
        raise InputError(f"ledger {path} is torn or foreign ({error}); put a good copy in its place") from error
    except UnicodeDecodeError as error:  # sqlite3 cannot even say what is wrong
        raise InputError(f"ledger {path} is torn or foreign (its schema is no text); put in a good copy") from error


def pragma(connection: sqlite3.Connection, name: str) -> int:
    """The number that a PRAGMA holds."""
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
