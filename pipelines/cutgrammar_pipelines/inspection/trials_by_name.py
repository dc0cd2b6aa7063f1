"""Finds a trial of a run by its name."""

import difflib
from collections.abc import Sequence
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.trials.record import Record


def records_in(run: Path) -> list[Record]:
    """The records of the run in folder `run`.

    Raises:
        InputError: `run` is not a run, or holds no trial.
    """
    read_run(run)
    records = read_records(ledger_of(run))
    if not records:
        raise InputError(f"{run} holds no trial yet; the same evaluate command resumes it")
    return records


def find_record(trial: str, records: Sequence[Record]) -> Record:
    """The record of the trial called `trial`.

    Args:
        trial: its name, or an unambiguous prefix of it.
        records: at least one.

    Raises:
        InputError: no trial has this name, or several begin with it.
    """
    by_name = {record.key.name: record for record in records}
    if trial in by_name:
        return by_name[trial]
    matches = [name for name in by_name if name.startswith(trial)]
    if len(matches) == 1:
        return by_name[matches[0]]
    if matches:
        raise InputError(f"trial {trial!r} is a prefix of {len(matches)} names, such as {matches[0]} and {matches[1]}")
    close = difflib.get_close_matches(trial, by_name, n=1, cutoff=0.0)[0]
    raise InputError(f"trial {trial!r} has no row in this run; the closest name is {close}")
