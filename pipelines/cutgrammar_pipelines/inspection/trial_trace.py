"""Finds a trial of a run by its name, and reproduces it with its shapes and motions."""

import difflib
import sys
from collections.abc import Sequence
from pathlib import Path

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.stages.evaluate.reproduce import worker_for
from cutgrammar_workers.trial_worker import TrialTrace


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


def trace_trial(run: Path, trial: str, by_arm: bool) -> tuple[TrialTrace, Demonstration]:
    """Reproduce a trial in which something was cut, in this process; return its trace and its demonstration.

    Args:
        run: a folder that `evaluate` made.
        trial: its name in the run, or an unambiguous prefix of it.
        by_arm: require that an arm made a cut.

    Raises:
        InputError: no run, no such trial, no cut was made in it, or not by an arm, or it cannot be reproduced.
    """
    record = find_record(trial, records_in(run))
    name, made = record.key.name, [event for event in record.events if event["event"] == "CutMade"]
    if not made:
        raise InputError(f"no cut was made in {name} ({record.status}: {record.reason}); choose another trial")
    if by_arm and not any("execution" in event for event in made):
        raise InputError(
            f"no arm moved in {name}: its world is {record.key.world}; choose a trial of a run with --world kinova"
        )
    print(f"{name} is carried out again", file=sys.stderr)
    worker, jobs = worker_for(run, [record.key])
    trace = worker.carry_out(jobs[0])
    note_difference(trace.record, record)
    return trace, jobs[0].demonstration


def note_difference(again: Record, record: Record) -> None:
    """Print a note if a reproduced trial differs from its record in the ledger."""
    if again.digest == record.digest:
        return
    print(
        f"NOTE the result differs: strict IoU {again.iou_strict:.6f}, {record.iou_strict:.6f} in the ledger; "
        "another machine or other versions of libraries can cause this",
        file=sys.stderr,
    )
