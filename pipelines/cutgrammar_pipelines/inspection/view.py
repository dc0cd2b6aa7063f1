"""Shows trials of a run in rerun; one that was not recorded is carried out again with the same seeds."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote

from cutgrammar.atomic_files import write_atomic
from cutgrammar.command_lines import command_line, program
from cutgrammar.errors import InputError
from cutgrammar.results.score_table import worst_first
from cutgrammar.storage.run_folder import (
    known_recording,
    place_for_recording,
    read_run,
    recording_of,
    recordings_elsewhere,
)
from cutgrammar.storage.shared_storage import read_file
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.config import ViewConfig
from cutgrammar_pipelines.inspection.trial_trace import note_difference
from cutgrammar_pipelines.inspection.trials_by_name import find_record, records_in
from cutgrammar_pipelines.stages.evaluate.reproduce import reproduce_trial
from cutgrammar_pipelines.stages.progress import note


def view(config: ViewConfig) -> int:
    """Show a trial, or list the worst ones; with `config.save`, write the recordings to a file instead.

    Returns:
        the exit code: 0, or that of the viewer.

    Raises:
        InputError: no run, no such trial, or it cannot be reproduced.
    """
    run, save = config.run, config.save
    records = records_in(run)
    if config.trial is None and config.compare is None and save is None:
        _list(run, worst_first(records)[: config.worst])
        return 0
    from cutgrammar_dashboards.recording import viewer

    if config.compare is not None:
        chosen = _pair(records, config.compare, config.trial)
        files = [_side_by_side(run, chosen)]
    else:
        chosen = worst_first(records)[: config.worst] if config.trial is None else [find_record(config.trial, records)]
        files = [_recorded(run, record) for record in chosen]
    if save is not None:
        save.parent.mkdir(parents=True, exist_ok=True)
        if len(files) == 1:
            write_atomic(save, files[0].read_bytes())
        else:
            viewer.merge(files, save)
        print(f"{save}: {', '.join(record.key.name for record in chosen)}")
        return 0
    if viewer.has_screen():
        return viewer.open_recordings(files)
    print(f"The recording is {files[0]}. There is no screen here; on a machine with one:")
    print(f"  rerun {quote(files[0].name)}")
    print(f"or in a browser on this machine:\n  {program('rerun')} --bind 127.0.0.1 --serve-web {quote(str(files[0]))}")
    return 0


def _pair(records: Sequence[Record], methods: tuple[str, str], trial: str | None) -> list[Record]:
    """The records of one trial by both methods.

    Args:
        records: of the run.
        methods: both.
        trial: name of a trial of one of them, or a prefix of it; None chooses the trial in which the second method
            loses most against the first.

    Raises:
        InputError: there is no such trial, or one of the methods has no record of it.
    """
    if methods[0] == methods[1]:
        raise InputError(f"--compare takes two different methods, not {methods[0]} twice")
    first, second = (
        {replace(record.key, method="", origin=""): record for record in records if record.key.method == method}
        for method in methods
    )
    both = [key for key in first if key in second]
    if not both:
        raise InputError(f"the run has no trial of both {methods[0]} and {methods[1]}")
    if trial is None:
        key = min(both, key=lambda key: (second[key].iou_strict - first[key].iou_strict, key))
        return [first[key], second[key]]
    named = [record for key in both for record in (first[key], second[key]) if record.key.name.startswith(trial)]
    if not named:
        raise InputError(
            f"{methods[0]} and {methods[1]} have no trial called {trial!r} in common; "
            f"one that they have is {first[both[0]].key.name}"
        )
    key = replace(named[0].key, method="", origin="")
    return [first[key], second[key]]


def _side_by_side(run: Path, pair: Sequence[Record]) -> Path:
    """A recording that shows both trials, in the run's folder."""
    from cutgrammar_dashboards.recording.comparison import write_side_by_side

    first, second = pair
    out = place_for_recording(run, f"{first.key.name}-beside-{second.key.method}")
    columns = {f"{record.key.method}, strict IoU {record.iou_strict:.3f}": _recorded(run, record) for record in pair}
    write_side_by_side(columns, f"{first.key.name} beside {second.key.method}", out)
    return out


def _list(run: Path, records: Sequence[Record]) -> None:
    width = max(len(record.key.name) for record in records)
    print(f"the worst trials of {run}, by strict IoU (*: recorded; others are carried out again when shown)")
    for record in records:
        star = "*" if recording_of(run, record.key.name).exists() else " "
        ending = record.status if record.reason is None else f"{record.status}: {' '.join(record.reason.split())}"
        print(f"{star} {record.key.name.ljust(width)}  {record.iou_strict:.3f}  {ending}")
    print(f"to see the first: {command_line('view', run, records[0].key.name)}")


def _recorded(run: Path, record: Record) -> Path:
    """The recording of a trial; if there is none, it is made by carrying the trial out again."""
    if known := known_recording(run, record.key.name):
        return known
    file = place_for_recording(run, record.key.name)
    elsewhere = recordings_elsewhere(read_run(run), record.key.origin)
    if elsewhere is not None and (content := read_file(elsewhere, file.name)) is not None:
        write_atomic(file, content)
        return file
    note(f"{record.key.name} was not recorded; it is carried out again")
    outcome = reproduce_trial(run, record.key)
    if outcome.recording is None:
        raise InputError(f"{record.key.name} cannot be recorded: {outcome.unrecorded or outcome.record.reason}")
    note_difference(outcome.record, record)
    write_atomic(file, outcome.recording)
    return file
