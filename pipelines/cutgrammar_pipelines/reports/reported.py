"""Remembers that the table of a run was printed and logged, so that resuming a finished run need not do it again."""

import contextlib
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.untrusted import read_json
from cutgrammar.version import __version__


def is_reported(run: Path, store: str) -> bool:
    """Whether `note_reported` was called for what the folder `run` holds now."""
    try:
        return bool(read_json(_file(run)) == _state(run, store))
    except (OSError, ValueError, InputError):
        return False


def note_reported(run: Path, store: str) -> None:
    """Remember that the table of what `run` holds now was printed, and logged in the MLflow store `store`."""
    with contextlib.suppress(OSError):  # then it is computed again
        write_atomic(_file(run), json_bytes(_state(run, store)))


def _state(run: Path, store: str) -> dict[str, Any]:
    facts = {path.name: path.stat() for path in (ledger_of(run), run / "ratings.sqlite") if path.exists()}
    files = {name: [stat.st_size, stat.st_mtime_ns] for name, stat in facts.items()}
    return {"files": files, "store": store, "package": __version__}


def _file(run: Path) -> Path:
    return run / ".reported.json"
