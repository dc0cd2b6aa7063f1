"""Sections of a report about single trials and the arm: pictures, the worst trials, recordings, provenance."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from cutgrammar.command_lines import command_line
from cutgrammar.events import DECIDING_SCORE
from cutgrammar.results.arm_work import ArmWork
from cutgrammar.results.comparisons import AGAINST
from cutgrammar.results.report import Cell, Row, Section, Table, TrialPicture, columns, keys, words
from cutgrammar.storage.run_folder import RunFacts
from cutgrammar.trials.record import FAILURES, Record, TrialKey

MAX_WORST = 12
"""Number of worst trials that are listed, and of failed ones after them."""


def arm_section(works: Sequence[ArmWork]) -> Section:
    """How an arm carried out the cuts of each method."""
    rows, reason_rows = [], []
    for work in works:
        name = Cell(f"{work.method}, {work.world}, {work.perception}")
        refused, failed = (sum(count for _, count in reasons) for reasons in (work.refused, work.failed))
        shares = (count / work.cuts for count in (work.moved, work.turned, work.cleared))
        cells = [name, Cell(work.cuts), *(Cell(share, ".0%") for share in shares), Cell(refused), Cell(failed)]
        cells += [Cell(work.plane_error_deg, ".3f"), Cell(work.plane_error_mm, ".3f")]
        cells += [Cell(work.torque_share, ".0%"), Cell(work.velocity_share, ".0%"), Cell(work.blade_force, ".0f")]
        cells += [Cell(work.broken), Cell(work.seconds, ".0f")]
        rows.append(Row(tuple(cells), "bad" if work.broken else ""))
        for what, counts in (("refused", work.refused), ("failed", work.failed)):
            reason_rows += [Row((name, Cell(what), Cell(count), Cell(reason))) for reason, count in counts]
    worst = ("plane off [degrees]", "plane off [mm]", "torque", "velocity", "force [N]")
    tables = [
        Table(
            "Cuts that the arm made, and in what share the fragment was moved, turned or cleared of others",
            (
                *keys("method"),
                *columns("cuts", "moved", "turned", "cleared", "refused", "failed", *worst, "limits broken", "seconds"),
            ),
            tuple(rows),
            "The worst of all cuts: plane, torque and velocity as shares of their limits, force on the blade.",
        )
    ]
    if reason_rows:
        fold = "Why cuts were refused or failed"
        heads = (*keys("method"), *words("what"), *columns("how often"), *words("why"))
        tables.append(Table("Reasons", heads, tuple(reason_rows), fold=fold))
    return Section("How the arm cut", tuple(tables))


def pictures_section(pictures: Sequence[TrialPicture], left_out: int = 0) -> Section:
    """What trials reached, to be turned.

    Args:
        pictures: of the trials.
        left_out: number of trials that the same choice would show, had the page no limit.
    """
    lead = (
        "Of each method the trials with the lowest, the median and the highest strict IoU, and those that --trials "
        "names. Each has its start, its goal and what was reached. Fragments matched with one another have one "
        "colour, those without a match are grey."
    )
    if left_out:
        lead += f" {left_out} more would make the page too large; --trials NAME shows them."
    return Section("What was reached", tuple(pictures), lead=lead, is_detail=True)


def ending_of(record: Record) -> str:
    """The deciding score of a trial and how it ended, e.g. "strict IoU 0.512, stuck: no production applies"."""
    ended = record.status + (f": {record.reason}" if record.reason else "")
    return f"strict IoU {record.iou_strict:.3f}, {record.fragments} of {record.goal_fragments} fragments, {ended}"


def view_command(run: Path, name: str) -> str:
    """The command that shows a trial step by step."""
    return command_line("view", run, name)


def worst_trials(records: Sequence[Record]) -> list[Record]:
    """The worst trials of the reference method (of all, if it is missing), then those of any method that failed.

    Args:
        records: the lowest deciding score first.
    """
    first = ([record for record in records if record.key.method == AGAINST] or list(records))[:MAX_WORST]
    failed = [record for record in records if record.status in FAILURES and record not in first]
    return first + failed[:MAX_WORST]


def worst_section(records: Sequence[Record], runs: Mapping[str, Path], recordings: Mapping[TrialKey, Path]) -> Section:
    """The worst trials with the commands that show them.

    Args:
        records: the trials, worst first.
        runs: origin -> run folder.
        recordings: those that exist.
    """
    rows = []
    for record in records:
        name, ended = record.key.name, record.status + (f": {record.reason}" if record.reason else "")
        reached = "?" if record.fragments is None else record.fragments
        command = view_command(runs[record.key.origin], name)
        row = (
            Cell(name),
            Cell(record.scores.get(DECIDING_SCORE), ".3f"),
            Cell(f"{reached} of {record.goal_fragments}"),
            Cell(ended),
            Cell(command, is_code=True),
            Cell("recording" if record.key in recordings else "", link=recordings.get(record.key)),
        )
        rows.append(Row(row))
    heads = (*keys("trial"), *columns("strict IoU", "fragments"), *words("how it ended", "to see it", ""))
    title = f"Lowest strict IoU of {AGAINST} first, then what failed of any method"
    return Section("The worst trials", (Table(title, heads, tuple(rows)),), is_detail=True)


def recordings_section(recordings: Mapping[TrialKey, Path]) -> Section:
    """Links to the recordings."""
    rows = tuple(Row((Cell(key.name, link=file),)) for key, file in recordings.items())
    return Section("Recordings", (Table("For the rerun viewer", keys("trial"), rows),), is_detail=True)


def provenance_section(runs: Sequence[tuple[Path, RunFacts]]) -> Section:
    """The data, models, settings and versions that the runs were made from."""
    lines = []
    for run, facts in runs:
        lines += [
            ("run", str(run)),
            ("seed", str(facts.seed)),
            ("cutgrammar", f"{facts.package}, commit {facts.commit or 'unknown'}"),
            ("data", f"{facts.data}, digest {facts.data_digest}"),
            ("split", f"{facts.split}, digest {facts.split_digest}"),
            *(
                (f"model of run {i}" if len(facts.models) > 1 else "model", f"{path}, digest {digest}")
                for i, (path, digest) in enumerate(zip(facts.models, facts.model_digests, strict=True))
            ),
            ("settings", json.dumps(facts.settings, sort_keys=True)),
            ("machine", json.dumps(facts.machine, sort_keys=True)),
        ]
        if facts.missing:
            lines.append(("trials missing from the data", ", ".join(map(str, facts.missing))))
    rows = tuple(Row((Cell(name), Cell(value, is_code=True))) for name, value in lines)
    heads = (*keys("what"), *words("value"))
    table = Table("Runs, digests, settings, versions", heads, rows)
    return Section("Where the numbers come from", (table,), is_detail=True)
