"""The sections of a report about single trials: pictures, worst trials, recordings, provenance."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from cutgrammar.results.arm_work import arm_work
from cutgrammar.results.comparisons import AGAINST
from cutgrammar.results.report import Section
from cutgrammar.results.score_table import Row, worst_first
from cutgrammar.results.trial_sections import (
    arm_section,
    pictures_section,
    provenance_section,
    recordings_section,
    worst_section,
    worst_trials,
)
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import read_configurations
from cutgrammar.storage.run_folder import ledger_of, read_run, recording_of
from cutgrammar.trials.record import Record, TrialKey

MAX_PICTURES = 6


def detail_sections(runs: Sequence[Path], rows: Sequence[Row]) -> list[Section]:
    """The sections about single trials; one that would be empty is left out.

    Args:
        runs: folders that `evaluate` made.
        rows: of these runs, each trial once.
    """
    facts = [(run, read_run(run)) for run in runs]
    runs_of: dict[str, list[Path]] = {}
    for run, fact in facts:
        for origin in fact.origins:
            runs_of.setdefault(origin, []).append(run)
    recordings = find_recordings(runs_of, rows)
    worst = worst_trials(worst_first(row.record for row in rows))
    sections = [
        arm_section(arm_work(row.record for row in rows)),
        pictures_section(_pictures(runs_of, rows)),
        worst_section(worst, {origin: folders[0] for origin, folders in runs_of.items()}, recordings),
        recordings_section(recordings),
        provenance_section(facts),
    ]
    return [section for section in sections if any(getattr(item, "rows", True) for item in section.items)]


def find_recordings(runs_of: dict[str, list[Path]], rows: Sequence[Row]) -> dict[TrialKey, Path]:
    """The recordings that exist, by the names of their trials; equal names in runs of different origin stay apart.

    Args:
        runs_of: origin -> run folders.
        rows: of these runs.
    """
    keys = sorted((row.record.key for row in rows), key=lambda key: (key.name, key))
    candidates = {key: [recording_of(run, key.name) for run in runs_of[key.origin]] for key in keys}
    return {key: file for key, files in candidates.items() if (file := next(filter(Path.exists, files), None))}


def _pictures(runs_of: dict[str, list[Path]], rows: Sequence[Row]) -> Iterator[tuple[Record, TrialConfigurations]]:
    """Up to `MAX_PICTURES` trials whose configurations are known, the setups in turn, the reference method first."""
    turns: Counter[str] = Counter()
    order = []
    records = (row.record for row in rows if row.record.events and "pairs" in row.record.events[-1])
    for record in sorted(records, key=lambda record: (record.key.method != AGAINST, record.key.run, record.key)):
        order.append((turns[record.key.setup], record))
        turns[record.key.setup] += 1
    shown = 0
    for _, record in sorted(order, key=lambda pair: pair[0]):
        if shown == MAX_PICTURES:
            return
        for run in runs_of[record.key.origin]:
            if (configurations := read_configurations(ledger_of(run), record.key)) is not None:
                shown += 1
                yield record, configurations
                break
