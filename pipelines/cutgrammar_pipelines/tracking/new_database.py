"""The database of a store without a server: made whole or not at all, and logged to by one process at a time.

MLflow fills a new database in dozens of steps. Killed within them, or raced by another process, it leaves one that can
never be used. So it is filled under another name, by one process at a time, and then renamed.
"""

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from pathlib import Path

SQLITE = "sqlite:///"


def database_file(uri: str) -> Path | None:
    """The database file of a store at `uri`; None for a server."""
    return Path(uri.removeprefix(SQLITE)) if uri.startswith(SQLITE) else None


def make_database(uri: str) -> None:
    """Make the database of a store at `uri` if it is a file that does not exist.

    Raises:
        OSError: it cannot be written.
        one of `mlflow_store.failures()`: MLflow could not fill it.
    """
    path = database_file(uri)
    if path is None or not path.name or path.exists():
        return
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    with path.with_name(f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if path.exists():
            return
        partial = path.with_name(f"{path.name}.new")
        partial.unlink(missing_ok=True)
        folder = (path.resolve().parent / "mlartifacts").as_uri()
        SqlAlchemyStore(f"{SQLITE}{partial}", folder).engine.dispose()
        os.replace(partial, path)


@contextlib.contextmanager
def one_at_a_time(uri: str, seconds: float) -> Iterator[None]:
    """A block in which no other process logs to a store at `uri`, if that is a file.

    What one has created, another would create again; and SQLite fails those who wait long for it.

    Args:
        uri: of the store.
        seconds: how long to wait [s]; after that the block begins, for the other process may have been stopped.

    Raises:
        OSError: the file of the lock cannot be written.
    """
    path = database_file(uri)
    if path is None or not path.exists():
        yield
        return
    with path.with_name(f"{path.name}.lock").open("w") as lock:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.1)
        yield
