"""The ratings of a run's results: one row an answer in one SQLite file, `ratings.sqlite`, beside the ledger.

An answer is synced to disk before the rater sees the next pair. Answers are never changed: who goes back and changes
their mind adds another one, and the last counts. One server at a time has the file open for writing.
"""

import fcntl
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote

from pydantic import Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.errors import InputError
from cutgrammar.storage.foreign_sqlite import check_database, guard
from cutgrammar.trials.rating_plan import KINDS
from cutgrammar.untrusted import check
from cutgrammar.untrusted.files import check_inside, open_lock
from cutgrammar.untrusted.kinds import STRICT, Digest, Seconds, Small

APPLICATION = 0x63757472
"""Marks the file as ratings of cutgrammar ("cutr")."""
SCHEMA = 1
LOWEST, HIGHEST = 1, 5
"""The paper's scale; higher is a better match."""
TIMEOUT = 20.0
"""How long one process waits for another to release the file [s]."""
TABLE = f"""CREATE TABLE ratings (
    rater TEXT NOT NULL CHECK (length(rater) BETWEEN 1 AND 32),
    robot INTEGER NOT NULL CHECK (robot IN (0, 1)),
    pair TEXT NOT NULL CHECK (length(pair) = 64),
    kind TEXT NOT NULL CHECK (kind IN {KINDS}),
    trial TEXT NOT NULL CHECK (length(trial) = 64),
    other TEXT CHECK ((other IS NULL) = (kind != 'other')),
    place INTEGER NOT NULL CHECK (place >= 0),
    answer INTEGER NOT NULL CHECK (answer >= 1),
    rating INTEGER NOT NULL CHECK (rating BETWEEN {LOWEST} AND {HIGHEST}),
    seconds REAL NOT NULL CHECK (seconds >= 0),
    at TEXT NOT NULL,
    UNIQUE (rater, pair, answer)
) STRICT"""


@dataclass(frozen=True)
class Rating:
    """One answer of a rater.

    Attributes:
        rater: code of the rater.
        robot: whether a test robot gave it: a browser driven by a program, or an event not made by a person.
        pair: digest of the pair (see `rating_plan.Pair`).
        kind: of the pair, one of `KINDS`.
        trial: digest of the key of the trial whose goal was shown.
        other: digest of the key of the trial whose goal was shown as the result, for a check of that kind.
        place: number of the pair in the rater's order, from 0.
        answer: 1 for the first answer to this pair, 2 for the first change, ...
        rating: from `LOWEST` to `HIGHEST`.
        seconds: time from when the pair was shown to the answer [s].
        at: when it was given, in UTC as ISO 8601.
    """

    rater: str
    robot: bool
    pair: str
    kind: str
    trial: str
    other: str | None
    place: int
    answer: int
    rating: int
    seconds: float
    at: str


@with_config(STRICT)
class RatingFacts(TypedDict):
    """A row of the table: see `Rating`."""

    rater: Annotated[str, Field(pattern=r"^[\w .-]{1,32}$")]
    robot: Annotated[int, Field(ge=0, le=1)]
    pair: Digest
    kind: Literal[KINDS]  # type: ignore[valid-type]
    trial: Digest
    other: Digest | None
    place: Small
    answer: Annotated[int, Field(ge=1, le=1_000_000)]
    rating: Annotated[int, Field(ge=LOWEST, le=HIGHEST)]
    seconds: Seconds
    at: Annotated[str, Field(pattern=r"^[\d:T.Z +-]{1,40}$")]


_RATING = TypeAdapter(RatingFacts)


def ratings_of(run: Path) -> Path:
    """The path of a run's ratings, which may not exist."""
    return run / "ratings.sqlite"


class RatingStore:
    """Ratings that are open for writing; only one server can have them open. One thread at a time may use it."""

    def __init__(self, path: Path) -> None:
        """Open the ratings at `path`, or create them.

        Raises:
            InputError: another server has them open; the file is torn, foreign, or has another schema.
        """
        self.path = path
        self._lock = open_lock(path.with_suffix(".lock"))
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._connection = _created(path)
        except BlockingIOError:
            self._lock.close()
            raise InputError(f"{path.parent} is being rated on another server; use that one, or end it") from None
        except BaseException:
            self._lock.close()
            raise

    def close(self) -> None:
        """Close the file and release it for other servers."""
        self._connection.close()
        self._lock.close()

    def add(self, rating: Rating) -> None:
        """Write an answer; when this returns, it is on disk.

        Raises:
            InputError: the rater has given this answer to the pair already.
            OSError: it could not be written, e.g. because the disk is full; nothing has changed.
        """
        marks = ", ".join("?" * len(fields(Rating)))
        with _clear_errors(self.path), self._connection as transaction:
            transaction.execute(f"INSERT INTO ratings VALUES ({marks})", astuple(rating))

    def all(self) -> list[Rating]:
        """All answers, in the order in which they were given."""
        with _clear_errors(self.path):
            return _rows(self._connection, self.path)


def read_ratings(run: Path) -> list[Rating]:
    """All answers about the run in folder `run`, in the order in which they were given; none if there is no file.

    Raises:
        InputError: the file is torn, foreign, or has another schema.
    """
    path = ratings_of(run)
    if not path.exists():
        return []
    check_database(path, f"there are no ratings {path}")
    mode = "rw" if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK) else "ro"
    with _clear_errors(path):
        connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode={mode}", timeout=TIMEOUT, uri=True)
        try:
            guard(connection)
            _check(connection, path)
            return _rows(connection, path)
        finally:
            connection.close()


def last_answers(ratings: Sequence[Rating]) -> list[Rating]:
    """The answers that count: the last of every rater to every pair."""
    last: dict[tuple[str, str], Rating] = {}
    for one in sorted(ratings, key=lambda rating: rating.answer):
        last[one.rater, one.pair] = one
    return sorted(last.values(), key=lambda rating: (rating.rater, rating.place, rating.pair))


def _created(path: Path) -> sqlite3.Connection:
    check_inside(path.resolve(), path.parent)
    if path.exists():
        check_database(path, f"there are no ratings {path}")
    with _clear_errors(path):
        connection = sqlite3.connect(path, timeout=TIMEOUT, check_same_thread=False)
        try:
            guard(connection)
            connection.execute("PRAGMA synchronous = EXTRA")
            empty = not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            if empty and not _pragma(connection, "application_id"):
                connection.executescript(
                    f"BEGIN; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {SCHEMA}; {TABLE}; COMMIT;"
                )
            _check(connection, path)
        except BaseException:
            connection.close()
            raise
        return connection


def _check(connection: sqlite3.Connection, path: Path) -> None:
    if _pragma(connection, "application_id") != APPLICATION:
        raise InputError(f"{path} does not hold ratings of cutgrammar; move it away, or rate another run")
    if (schema := _pragma(connection, "user_version")) != SCHEMA:
        raise InputError(f"{path} has schema {schema}, not {SCHEMA}: it is of another version of cutgrammar")
    tables = connection.execute("SELECT sql FROM sqlite_master WHERE type != 'index'").fetchall()
    if tables != [(TABLE,)]:
        raise InputError(f"{path} does not have the one table of ratings; put a good copy in its place")
    (state,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if state != "ok":
        raise InputError(f"{path} is torn ({state.splitlines()[0]}); put a good copy in its place")


def _rows(connection: sqlite3.Connection, path: Path) -> list[Rating]:
    names = [field.name for field in fields(Rating)]
    rows = connection.execute(f"SELECT {', '.join(names)} FROM ratings ORDER BY rowid").fetchall()
    for number, row in enumerate(rows, start=1):
        try:
            check(_RATING, dict(zip(names, row, strict=True)))
        except ValueError as error:
            raise InputError(f"{path}: answer {number} is no rating: {error}; put a good copy in its place") from None
    return [Rating(row[0], bool(row[1]), *row[2:]) for row in rows]


@contextmanager
def _clear_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.IntegrityError as error:
        raise InputError(f"{path} refuses a rating ({error})") from error
    except sqlite3.OperationalError as error:  # a full disk, a folder that may not be written
        raise OSError(f"{path} cannot be used: {error}") from error
    except sqlite3.DatabaseError as error:
        raise InputError(f"{path} is torn or foreign ({error}); put a good copy in its place") from error
    except UnicodeDecodeError as error:  # sqlite3 cannot even say what is wrong
        raise InputError(f"{path} is torn or foreign (its schema is no text); put a good copy in its place") from error


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
