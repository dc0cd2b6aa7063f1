"""The sections of a report that show two runs side by side."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.results.report import Report, Section, TrialPicture, TrialResult
from cutgrammar.results.score_table import Row
from cutgrammar.results.shown_trials import MAX_TRIALS, NAMED, pairs_of
from cutgrammar.results.side_by_side import Side, SideBySide
from cutgrammar.results.side_by_side_section import side_by_side_section
from cutgrammar.results.trial_sections import ending_of, view_command
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.inspection.trials_by_name import find_record
from cutgrammar_pipelines.reports.trial_details import find_recordings, folders_by_origin, known_configurations

LOSS, MEDIAN, GAIN = "the greatest loss", "the median difference", "the greatest gain"


def put_beside(
    report: Report,
    runs: Sequence[Path],
    rows: Sequence[Row],
    others: Sequence[Path],
    other_rows: Sequence[Row],
    named: Sequence[str] = (),
) -> Report:
    """A report of `runs` with sections, before the others, that compare it with `others`.

    Args:
        report: of `runs`.
        runs, others: folders that `evaluate` made.
        rows, other_rows: theirs, each trial once.
        named: names of trials of `runs` that are shown in any case.

    Raises:
        InputError: they have no trial of a method in common.
    """
    names = _names(runs, others)
    both = SideBySide(Side(names[0], rows), Side(names[1], other_rows))
    if not both.trials():
        raise InputError(
            f"{names[0]} and {names[1]} have no trial of the same data, goals and method in common, so they cannot "
            "stand side by side; to pool them in one table, name them one after the other, without --beside"
        )
    section = side_by_side_section(both)
    shown = _pictures(both, (runs, others), named)
    lead = (
        f"Of each method the trials in which {names[1]} loses most, differs by the median, and gains most, and those "
        "that --trials names. Fragments have the colour of the goal fragment that they are matched with; those without "
        "a match are grey."
    )
    trials = Section("The same trials of both", tuple(shown), lead=lead, is_detail=True)
    return dataclasses.replace(
        report,
        numbers={**report.numbers, "beside": both.to_json()},
        sections=(section, *([trials] if shown else []), *report.sections),
    )


def _pictures(
    both: SideBySide, folders: tuple[Sequence[Path], Sequence[Path]], named: Sequence[str]
) -> list[TrialPicture]:
    """The chosen trials with the results of both runs, where their configurations are known."""
    chosen = _chosen(both.trials(), named)
    records = [[pair[side] for _, pair in chosen] for side in (0, 1)]
    runs_of = [folders_by_origin(runs) for runs in folders]
    known = [known_configurations(of, [r.key for r in of_side]) for of, of_side in zip(runs_of, records, strict=True)]
    sides = both.first, both.second
    recordings = [find_recordings(of, side.rows) for of, side in zip(runs_of, sides, strict=True)]
    pictures = []
    for why, pair in chosen:
        if any(record.key not in of_side for record, of_side in zip(pair, known, strict=True)):
            continue
        results = tuple(
            TrialResult(
                side.name,
                ending_of(record),
                of_side[record.key][1].reached,
                pairs_of(record),
                view_command(of_side[record.key][0], record.key.name),
                found.get(record.key),
            )
            for side, record, of_side, found in zip(sides, pair, known, recordings, strict=True)
        )
        key, configurations = pair[0].key, known[0][pair[0].key][1]
        if len(configurations.goal) != len(known[1][pair[1].key][1].goal):
            continue  # the pairs of both must be of the same goal fragments
        gain = pair[1].iou_strict - pair[0].iou_strict
        caption = f"{key.name}: {why}, {gain:+.3f}"
        fold = "Named trials" if why == NAMED else f"{key.method}, goals {key.goals}"
        pictures.append(TrialPicture(caption, configurations.start, configurations.goal, results, fold))
    return pictures


def _chosen(trials: Sequence[tuple[Record, Record]], named: Sequence[str]) -> list[tuple[str, tuple[Record, Record]]]:
    """Why each trial is shown, and its records; `trials` begin with the greatest loss of the second run."""
    of = {pair[0].key: pair for pair in trials}
    chosen = {}
    for name in named:
        record = find_record(name, [pair[0] for pair in trials])
        chosen[record.key] = (NAMED, of[record.key])
    groups: dict[tuple[str, str], list[tuple[Record, Record]]] = {}
    for pair in trials:
        if all(pairs_of(record) for record in pair):
            groups.setdefault((pair[0].key.goals, pair[0].key.method), []).append(pair)
    for group in list(groups.values())[: MAX_TRIALS // 3]:
        for why, pair in ((LOSS, group[0]), (MEDIAN, group[(len(group) - 1) // 2]), (GAIN, group[-1])):
            chosen.setdefault(pair[0].key, (why, pair))
    return list(chosen.values())


def _names(runs: Sequence[Path], others: Sequence[Path]) -> tuple[str, str]:
    """Short names that tell both apart."""
    for depth in (1, 2, 3):
        names = [
            " + ".join("/".join(folder.resolve().parts[-depth:]) for folder in folders) for folders in (runs, others)
        ]
        if names[0] != names[1]:
            return names[0], names[1]
    return " + ".join(map(str, runs)), " + ".join(map(str, others))
