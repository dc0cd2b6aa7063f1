"""The sections of a report about single trials: pictures, worst trials, recordings, provenance."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from cutgrammar.results.arm_work import arm_work
from cutgrammar.results.report import Section, TrialPicture, TrialResult
from cutgrammar.results.score_table import Row, worst_first
from cutgrammar.results.shown_trials import NAMED, choose_trials, pairs_of
from cutgrammar.results.trial_sections import (
    arm_section,
    ending_of,
    pictures_section,
    provenance_section,
    recordings_section,
    view_command,
    worst_section,
    worst_trials,
)
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import read_known_configurations
from cutgrammar.storage.run_folder import ledger_of, read_run, recording_of, recordings_of
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar_pipelines.inspection.trials_by_name import find_record


def detail_sections(runs: Sequence[Path], rows: Sequence[Row], trials: Sequence[str] = ()) -> list[Section]:
    """The sections about single trials; one that would be empty is left out.

    Args:
        runs: folders that `evaluate` made.
        rows: of these runs, each trial once.
        trials: names of trials that are shown in any case.

    Raises:
        InputError: no trial has such a name, or several begin with it.
    """
    records = [row.record for row in rows]
    facts = [(run, read_run(run)) for run in runs]
    runs_of = folders_by_origin(runs)
    recordings = find_recordings(runs_of, rows)
    worst = worst_trials(worst_first(row.record for row in rows))
    sections = [
        arm_section(arm_work(row.record for row in rows)),
        pictures_section(*_pictures(runs_of, records, recordings, named_records(trials, records))),
        worst_section(worst, {origin: folders[0] for origin, folders in runs_of.items()}, recordings),
        recordings_section(recordings),
        provenance_section(facts),
    ]
    return [section for section in sections if any(getattr(item, "rows", True) for item in section.items)]


def folders_by_origin(runs: Sequence[Path]) -> dict[str, list[Path]]:
    """Origin of trials -> the run folders that may hold them."""
    runs_of: dict[str, list[Path]] = {}
    for run in runs:
        for origin in read_run(run).origins:
            runs_of.setdefault(origin, []).append(run)
    return runs_of


def find_recordings(runs_of: Mapping[str, Sequence[Path]], rows: Sequence[Row]) -> dict[TrialKey, Path]:
    """The recordings that exist, by the names of their trials; equal names in runs of different origin stay apart.

    Args:
        runs_of: origin -> run folders.
        rows: of these runs.
    """
    found = {run: set(recordings_of(run)) for run in dict.fromkeys(run for runs in runs_of.values() for run in runs)}
    if not any(found.values()):
        return {}
    recordings = {}
    for key in sorted((row.record.key for row in rows), key=lambda key: (key.name, key.values)):
        files = ((run, recording_of(run, key.name)) for run in runs_of[key.origin])
        if file := next((file for run, file in files if file in found[run]), None):
            recordings[key] = file
    return recordings


def _pictures(
    runs_of: Mapping[str, Sequence[Path]],
    records: Sequence[Record],
    recordings: Mapping[TrialKey, Path],
    named: Sequence[Record],
) -> tuple[list[TrialPicture], int]:
    """The trials that a page shows in three dimensions, and how many were left out."""
    chosen, left_out = choose_trials(records, named)
    known = known_configurations(runs_of, [record.key for _, record in chosen])
    several_conditions = len({(record.key.world, record.key.perception) for record in records}) > 1
    pictures = []
    for why, record in chosen:
        if (shown := known.get(record.key)) is not None:
            key = record.key
            run, configurations = shown
            result = TrialResult(
                "reached",
                ending_of(record),
                configurations.reached,
                pairs_of(record),
                view_command(run, key.name),
                recordings.get(key),
            )
            fold = f"{key.method}, goals {key.goals}"
            if several_conditions:
                fold += f", world {key.world}, perception {key.perception}"
            caption = f"{key.name}: {why}"
            pictures.append(
                TrialPicture(
                    caption,
                    configurations.start,
                    configurations.goal,
                    (result,),
                    "Named trials" if why == NAMED else fold,
                )
            )
    return pictures, left_out


def known_configurations(
    runs_of: Mapping[str, Sequence[Path]], keys: Sequence[TrialKey]
) -> dict[TrialKey, tuple[Path, TrialConfigurations]]:
    """For each trial whose configurations are known, the run that holds them, and these.

    Args:
        runs_of: origin -> run folders.
        keys: of the trials.
    """
    found: dict[TrialKey, tuple[Path, TrialConfigurations]] = {}
    for run in dict.fromkeys(run for runs in runs_of.values() for run in runs):
        wanted = [key for key in keys if key not in found and run in runs_of[key.origin]]
        found |= {key: (run, known) for key, known in read_known_configurations(ledger_of(run), wanted).items()}
    return found


def named_records(names: Sequence[str], records: Sequence[Record]) -> list[Record]:
    """The records of the trials called so; an unambiguous prefix of a name suffices.

    Raises:
        InputError: no trial has such a name, or several begin with it.
    """
    found = [find_record(name, records) for name in names]
    return list({record.key: record for record in found}.values())
