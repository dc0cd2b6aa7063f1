"""Reproduces a trial with its shapes and motions."""

import sys
from pathlib import Path

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.inspection.trials_by_name import find_record, records_in
from cutgrammar_pipelines.stages.evaluate.reproduce import worker_for
from cutgrammar_pipelines.stages.progress import note
from cutgrammar_workers.trial_worker import TrialTrace


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
    note(f"{name} is carried out again")
    worker, jobs = worker_for(run, [record.key])
    trace = worker.carry_out(jobs[0])
    note_difference(trace.record, record)
    demonstration = jobs[0].demonstration
    assert demonstration is not None  # a reproduction reads it itself
    return trace, demonstration


def note_difference(again: Record, record: Record) -> None:
    """Print a note if a reproduced trial differs from its record in the ledger."""
    if again.digest == record.digest:
        return
    print(
        f"NOTE the result differs: strict IoU {again.iou_strict:.6f}, {record.iou_strict:.6f} in the ledger; "
        "another machine or other versions of libraries can cause this",
        file=sys.stderr,
    )
