"""The ledger of a run: one row a trial in one SQLite file, which the driver alone writes.

Each record is written together with the configurations of its trial, in a transaction that is synced to disk: when the
driver dies, the ledger holds every trial that was reported done, once. The keys of all planned trials are
kept too, so that a reader can tell which are missing. Scores can be queried in SQL through the view `scores`.
"""

import contextlib
import gc
import hashlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar.storage import attempts
from cutgrammar.storage.attempts import Attempt, AttemptSummary
from cutgrammar.storage.configurations import ROLES, Contents, TrialConfigurations, contents_of, decode
from cutgrammar.storage.ledger_file import KEY, RESULT, clear_errors, connect, locked, note_whole, pragma, reading
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar.trials.record_schema import check_key


@dataclass(frozen=True, eq=False)
class Entry:
    """What the ledger gets of a trial; see `Ledger.add`."""

    record: Record
    configurations: TrialConfigurations | Contents | None
    attempt: Attempt
    replaces: bool = False


class Ledger:
    """A ledger that is open for writing; only one driver can have it open."""

    def __init__(self, path: Path) -> None:
        """Open the ledger at `path`, or create it; one of schema 2 becomes one of schema 3.

        Raises:
            InputError: another driver has it open; the file is torn, not a ledger, or has another schema.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._lock = locked(path)
        try:
            self._connection = connect(path)
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
        with contextlib.suppress(OSError):  # the folder was removed meanwhile
            note_whole(self.path)
        self._lock.close()

    def plan(self, keys: Iterable[TrialKey]) -> None:
        """Add the keys of trials that are to be carried out."""
        rows = [(key.digest, *_values(key, KEY)) for key in keys]
        with clear_errors(self.path), self._connection as transaction:
            transaction.executemany(f"INSERT OR IGNORE INTO planned VALUES ({_marks(1 + len(KEY))})", rows)

    def add(
        self,
        record: Record,
        configurations: TrialConfigurations | Contents | None = None,
        attempt: Attempt | None = None,
        replaces: bool = False,
    ) -> bool:
        """Write a record, the attempt that gave it, and the configurations of its trial, where they are known.

        Args:
            record: of the trial.
            configurations: of the trial, or their contents.
            attempt: who carried it out, when, and with which versions.
            replaces: it takes the place of an existing record, which is kept with its attempt.

        Returns:
            False, and nothing is changed, if the ledger already has a record with this key.
        """
        return self.add_all([Entry(record, configurations, attempt or Attempt(), replaces)]) == 1

    def add_all(self, entries: Sequence[Entry]) -> int:
        """Write several as `add` does, all or none of them, synced to disk once; the number of those that are new."""
        rows = [(entry, _row(entry.record), _contents(entry.configurations)) for entry in entries]
        count = 0
        with clear_errors(self.path), self._connection as transaction:
            for entry, row, contents in rows:
                digest, record = row[0], entry.record
                if entry.replaces:
                    attempts.supersede(transaction, digest)
                done = transaction.execute(f"INSERT OR IGNORE INTO records VALUES ({_marks(len(row))})", row)
                if done.rowcount != 1:
                    continue
                count += 1
                attempts.add_attempt(transaction, digest, record.status, record.reason, entry.attempt)
                for role, (content_digest, content) in contents.items():
                    transaction.execute("INSERT OR IGNORE INTO contents VALUES (?, ?)", (content_digest, content))
                    transaction.execute("INSERT INTO configurations VALUES (?, ?, ?)", (digest, role, content_digest))
        return count

    def add_fault(self, key: TrialKey, reason: str, attempt: Attempt) -> None:
        """Write an attempt that a fault of the machine ended; it gives no record."""
        with clear_errors(self.path), self._connection as transaction:
            attempts.add_attempt(transaction, key.digest, attempts.FAULT, reason, attempt)

    def keys(self, statuses: Iterable[str] = ()) -> set[str]:
        """The digests of the keys of all records, or of those that ended with one of `statuses`."""
        chosen = tuple(statuses)
        where = f" WHERE status IN ({_marks(len(chosen))})" if chosen else ""
        with clear_errors(self.path):
            return {key for (key,) in self._connection.execute(f"SELECT key FROM records{where}", chosen)}

    def attempts(self) -> AttemptSummary:
        """What the attempts so far come to."""
        with clear_errors(self.path):
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
    with reading(path) as connection, _uncollected():
        for number, content in connection.execute(f"SELECT rowid, CAST({column} AS BLOB) FROM records"):
            try:
                record = Record.from_text(content)
            except (TypeError, ValueError) as error:
                raise InputError(
                    f"ledger {path}: row {number} is not a record ({error}); put a good copy in place"
                ) from error
            records.append(record.condensed() if condensed else record)
    return sorted(records, key=lambda record: record.key.values)


def read_statuses(path: Path) -> dict[str, str]:
    """The digest of each record's key -> how its trial ended, without reading the records themselves.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with reading(path) as connection:
        return dict(connection.execute("SELECT key, status FROM records"))


def read_planned(path: Path) -> list[TrialKey]:
    """The keys of all trials ever planned in the ledger at `path`, sorted, while a driver may be writing it.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with reading(path) as connection:
        return [TrialKey(*values) for values in sorted(_planned(connection, path))]


def count_missing(path: Path) -> int:
    """The number of trials planned in the ledger at `path` that have no record, while a driver may be writing it.

    Raises:
        InputError: there is no ledger, or it is torn.
    """
    with reading(path) as connection:
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
    with reading(path) as connection:
        if pragma(connection, "user_version") == 1:
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
    with reading(path) as connection:
        if pragma(connection, "user_version") == 1:
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
    with reading(path) as connection:
        return attempts.summary(connection) if pragma(connection, "user_version") >= 3 else AttemptSummary((), {})


def _row(record: Record) -> tuple[Any, ...]:
    """The columns of a record."""
    text = json.dumps(record.to_json(), sort_keys=True, allow_nan=False)
    return (record.key.digest, *_values(record.key, KEY), *_values(record, RESULT), text)


def _contents(configurations: TrialConfigurations | Contents | None) -> dict[str, tuple[str, bytes]]:
    """Role -> digest and content, of all roles or none."""
    if isinstance(configurations, TrialConfigurations):
        configurations = contents_of(configurations)
    return {role: (hashlib.sha256(content).hexdigest(), content) for role, content in (configurations or {}).items()}


def _values(thing: object, names: tuple[str, ...]) -> tuple[Any, ...]:
    return tuple(getattr(thing, name) for name in names)


def _marks(number: int) -> str:
    return ", ".join("?" * number)
