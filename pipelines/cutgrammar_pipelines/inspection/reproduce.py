"""One trial of a run: found by its name, and carried out once more with its shapes and motions."""

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
        InputError: no run, or one without a trial.
    """
    read_run(run)
    records = read_records(ledger_of(run))
    if not records:
        raise InputError(f"{run} holds no trial yet; the evaluate command that made it goes on with it")
    return records


def record_called(trial: str, records: Sequence[Record]) -> Record:
    """The record of the trial called so.

    Args:
        trial: its name, or a beginning of it that no other has.
        records: at least one.

    Raises:
        InputError: none is, or a beginning of a name that several have.
    """
    by_name = {record.key.name: record for record in records}
    if trial in by_name:
        return by_name[trial]
    begun = [name for name in by_name if name.startswith(trial)]
    if len(begun) == 1:
        return by_name[begun[0]]
    if begun:
        raise InputError(f"trial {trial!r} is the beginning of {len(begun)} names, such as {begun[0]} and {begun[1]}")
    close = difflib.get_close_matches(trial, by_name, n=1, cutoff=0.0)[0]
    raise InputError(f"trial {trial!r} has no row in this run; the closest name is {close}")


def trace_trial(run: Path, trial: str, by_arm: bool) -> tuple[TrialTrace, Demonstration]:
    """A trial in which something was cut, carried out once more in this process, and the demonstration it is from.

    Args:
        run: a folder that `evaluate` made.
        trial: its name in the run, or a beginning of it that no other has.
        by_arm: an arm must have made a cut.

    Raises:
        InputError: no run, no such trial, nothing was cut in it, or not by an arm, or it cannot be carried out again.
    """
    record = record_called(trial, records_in(run))
    name, made = record.key.name, [event for event in record.events if event["event"] == "CutMade"]
    if not made:
        raise InputError(f"no cut was made in {name} ({record.status}: {record.reason}); choose another trial")
    if by_arm and not any("execution" in event for event in made):
        raise InputError(
            f"no arm moved in {name}: its world is {record.key.world}; choose a trial of a run with --world kinova"
        )
    print(f"{name} is carried out again", file=sys.stderr)
    worker, jobs = worker_for(run, [record.key])
    job = jobs[0]
    story = worker.carry_out(job)
    tell_if_different(story.record, record)
    return story, job.demonstration


def tell_if_different(again: Record, record: Record) -> None:
    """Say so where a trial that was carried out again came out differently than its record in the ledger."""
    if again.digest == record.digest:
        return
    print(
        f"NOTE it came out differently: strict IoU {again.iou_strict:.6f}, {record.iou_strict:.6f} in the ledger; "
        "another machine or other versions of libraries may be why",
        file=sys.stderr,
    )
