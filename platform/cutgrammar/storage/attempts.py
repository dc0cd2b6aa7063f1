"""The attempts at the trials of a run: which process carried out which, when, and with which versions.

They are two tables of the ledger. Versions are the same for nearly all attempts of a run, so each set of them is stored
once. The attempt whose result is in the table `records` has no record here; one that was superseded keeps its own.
"""

import json
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from cutgrammar.errors import InputError
from cutgrammar.trials.record import STATUSES
from cutgrammar.untrusted import parse_json, shortened

FAULT = "infrastructure"
"""Status of an attempt that a fault of the machine ended; it is no status of a record, and no score."""
TABLES = """
CREATE TABLE versions (number INTEGER PRIMARY KEY, content TEXT NOT NULL UNIQUE);
CREATE TABLE attempts (key TEXT NOT NULL, attempt INTEGER NOT NULL, status TEXT NOT NULL, reason TEXT, host TEXT,
    pid INTEGER, started REAL, ended REAL, versions INTEGER REFERENCES versions (number), record TEXT,
    PRIMARY KEY (key, attempt)) WITHOUT ROWID;
"""
COLUMNS = {
    "versions": ("number", "content"),
    "attempts": ("key", "attempt", "status", "reason", "host", "pid", "started", "ended", "versions", "record"),
}
"""Table -> columns that are read."""
OF_EXISTING = "INSERT INTO attempts (key, attempt, status, reason) SELECT key, 1, status, reason FROM records;"
"""Gives the records of a ledger of schema 2 their attempts, of which nothing further is known."""
_CURRENT = f"record IS NULL AND status <> '{FAULT}'"


@dataclass(frozen=True)
class Attempt:
    """One attempt at a trial.

    Attributes:
        host: name of the machine; None where it is not known.
        pid: process id there; None where it is not known.
        started, ended: seconds since 1970-01-01 UTC; None where they are not known.
        versions: name -> version of all that can change a result: of packages, of source code, of the commit.
    """

    host: str | None = None
    pid: int | None = None
    started: float | None = None
    ended: float | None = None
    versions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class AttemptSummary:
    """What the attempts of a run come to.

    Attributes:
        versions: each set of versions and the number of records that it gave, the most frequent first; the set is empty
            for records that were made before versions were kept.
        superseded: status -> number of attempts that ended so and whose record does not count, or that gave none.
    """

    versions: tuple[tuple[Mapping[str, str], int], ...]
    superseded: Mapping[str, int]


def add_attempt(transaction: sqlite3.Connection, key: str, status: str, reason: str | None, attempt: Attempt) -> None:
    """Write an attempt at the trial whose key has the digest `key`; it gets the next number, from 1."""
    number = None
    if attempt.versions:
        content = json.dumps(dict(attempt.versions), sort_keys=True)
        transaction.execute("INSERT OR IGNORE INTO versions (content) VALUES (?)", (content,))
        (number,) = transaction.execute("SELECT number FROM versions WHERE content = ?", (content,)).fetchone()
    (last,) = transaction.execute("SELECT max(attempt) FROM attempts WHERE key = ?", (key,)).fetchone()
    row = (key, (last or 0) + 1, status, reason, attempt.host, attempt.pid, attempt.started, attempt.ended, number)
    transaction.execute(f"INSERT INTO attempts VALUES ({', '.join('?' * len(row))}, NULL)", row)


def supersede(transaction: sqlite3.Connection, key: str) -> None:
    """Move the record of a trial, if there is one, from the table `records` to its attempt."""
    moved = transaction.execute("SELECT record FROM records WHERE key = ?", (key,)).fetchone()
    if moved is not None:
        transaction.execute(f"UPDATE attempts SET record = ? WHERE key = ? AND {_CURRENT}", (moved[0], key))
        transaction.execute("DELETE FROM records WHERE key = ?", (key,))
        transaction.execute("DELETE FROM configurations WHERE key = ?", (key,))


def summary(connection: sqlite3.Connection) -> AttemptSummary:
    """What all attempts come to.

    Raises:
        InputError: what is stored are no versions.
    """
    query = (
        f"SELECT content, n FROM (SELECT versions, count(*) AS n FROM attempts WHERE {_CURRENT} GROUP BY versions) "
        "LEFT JOIN versions ON number = versions ORDER BY n DESC, content"
    )
    versions = tuple((_versions(content), n) for content, n in connection.execute(query))
    query = f"SELECT status, count(*) FROM attempts WHERE NOT ({_CURRENT}) GROUP BY status ORDER BY status"
    return AttemptSummary(versions, {s: n for s, n in connection.execute(query) if s in (*STATUSES, FAULT)})


def _versions(content: object) -> dict[str, str]:
    try:
        found = {} if content is None else parse_json(content) if isinstance(content, str) else None
    except ValueError:
        found = None
    if not isinstance(found, dict) or not all(isinstance(version, str) for version in found.values()):
        raise InputError(f"a ledger holds versions that are none ({shortened(content)}); put a good copy in its place")
    return found


def differing_versions(sets: Iterable[tuple[Mapping[str, str], int]]) -> dict[str, dict[str, int]]:
    """Name -> version -> number of records, of all that has more than one version in `sets`.

    A set that lacks a name, as that of a method that is no plugin, says nothing of it. Commits that left the code as it
    was are no difference.
    """
    found: dict[str, dict[str, int]] = {}
    for versions, n in sets:
        for name, value in versions.items():
            counts = found.setdefault(name, {})
            counts[value] = counts.get(value, 0) + n
    differ = {name: counts for name, counts in sorted(found.items()) if len(counts) > 1}
    if "code" not in differ:
        differ.pop("commit", None)
    return differ
