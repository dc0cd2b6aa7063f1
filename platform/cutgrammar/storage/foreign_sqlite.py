"""SQLite files of strangers: what is read must be stored rows, and nothing runs while they are read.

A view can be endless, a computed column huge, a trigger or virtual table can run what its author likes, and the journal
of a transaction can name another file, which SQLite would then delete.
"""

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.untrusted import check_regular
from cutgrammar.untrusted.printing import shortened

MAX_VALUE = 200_000_000
"""Most bytes of one value of a row."""
_NAMES_A_FILE = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
"""The end of a journal of several databases; it follows the name of the file that joins them."""


def check_database(path: Path, missing: str) -> None:
    """Check, before SQLite opens it, that `path` is an ordinary file with its journal, if any, beside it.

    Args:
        path: of the database.
        missing: what to say where there is no such file.

    Raises:
        InputError: it is not.
    """
    try:
        check_regular(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(missing) from None
    with path.open("rb") as file:
        header = file.read(20)
    if header[18:20] not in (b"", b"\x01\x01"):
        raise InputError(f"{path} is torn or foreign (it has a write-ahead log); put a good copy in its place")
    journal = path.with_name(f"{path.name}-journal")
    if not journal.exists():
        return
    check_regular(journal)
    with journal.open("rb") as file:
        file.seek(max(0, journal.stat().st_size - len(_NAMES_A_FILE)))
        if file.read() == _NAMES_A_FILE:
            raise InputError(f"{journal} names another file, which no journal of cutgrammar does; remove it")


def guard(connection: sqlite3.Connection) -> None:
    """Bound what reading can take, and turn off what a schema could run."""
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE)
    connection.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    connection.text_factory = _text
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")


def _text(content: bytes) -> str:
    """Stored text, of which a schema refuses what is no UTF-8."""
    return content.decode("utf-8", "replace")


def check_tables(connection: sqlite3.Connection, path: Path, columns: Mapping[str, Sequence[str]]) -> None:
    """Check that all that is read are stored columns of ordinary tables.

    Args:
        connection: to the database.
        path: of the database, for messages.
        columns: table -> its columns that are read.

    Raises:
        InputError: a table or column is missing, computed or virtual, or there is a trigger or an index of its own.
    """
    rows = connection.execute("SELECT type, name, substr(sql, 1, 20) FROM sqlite_master LIMIT 1000").fetchall()
    kinds = {name: (kind, sql or "") for kind, name, sql in rows}
    for name, (kind, _) in kinds.items():
        if kind == "trigger" or (kind == "index" and not str(name).startswith("sqlite_autoindex_")):
            raise InputError(f"{path} has a {kind} {shortened(name)}, which no file of cutgrammar has; remove it")
    for table, names in columns.items():
        kind, sql = kinds.get(table, ("nothing", ""))
        if kind != "table" or not str(sql).upper().startswith("CREATE TABLE"):
            found = "virtual" if kind == "table" else kind
            raise InputError(f"{path}: {table} is {found}, not a table; put a good copy in its place")
        stored = {name for _, name, *_, hidden in connection.execute(f"PRAGMA table_xinfo({table})") if hidden == 0}
        if missing := [name for name in names if name not in stored]:
            raise InputError(
                f"{path}: the table {table} has no stored column {missing[0]!r}; put a good copy in its place"
            )
