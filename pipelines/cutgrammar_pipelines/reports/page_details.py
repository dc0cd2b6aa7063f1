"""What the page shows beside the numbers, gathered from the runs: differences, worst trials, pictures, digests."""

import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from cutgrammar.results.arm_work import arm_work
from cutgrammar.results.comparisons import AGAINST, Condition
from cutgrammar.results.score_table import Row, by_trial, worst_first
from cutgrammar.storage.run_folder import read_run, recording_of
from cutgrammar.trials.record import TrialKey
from cutgrammar_dashboards.recording.read_back import configurations_of
from cutgrammar_dashboards.report.page import PageDetails, Picture, WorstTrial

WORST = 12
PICTURES = 6
"""Most trials that the page lists, of either kind, and draws."""


def details_of(runs: Sequence[Path], rows: Sequence[Row], out: Path) -> PageDetails:
    """The details of `runs`, with addresses relative to a page at `out`.

    Args:
        runs: folders that `evaluate` made.
        rows: theirs, each trial once.
        out: where the page will stand.
    """
    files = _files(runs, rows)
    address = {key: Path(os.path.relpath(file, out.parent)).as_posix() for key, file in files.items()}
    return PageDetails(
        differences=_differences(rows),
        worst=_worst(runs, rows, address),
        recordings=[(key.name, where) for key, where in address.items()],
        pictures=list(_pictures(rows, files)),
        arm=arm_work(row.record for row in rows),
        provenance=_provenance(runs),
    )


def _files(runs: Sequence[Path], rows: Sequence[Row]) -> dict[TrialKey, Path]:
    """The recordings there are, by name; trials of one name in runs of different origin keep apart."""
    runs_of: dict[str, list[Path]] = {}
    for run in runs:
        runs_of.setdefault(read_run(run).origin, []).append(run)
    keys = sorted((row.record.key for row in rows), key=lambda key: (key.name, key))
    found = {key: [recording_of(run, key.name) for run in runs_of[key.origin]] for key in keys}
    return {key: file for key, files in found.items() if (file := next(filter(Path.exists, files), None))}


def _differences(rows: Sequence[Row]) -> dict[Condition, dict[str, dict[str, list[float]]]]:
    """Condition -> method -> setup -> strict IoU of its trials minus that of the reference."""
    scores = by_trial(rows)
    result: dict[Condition, dict[str, dict[str, list[float]]]] = {}
    for (condition, method), ours in scores.items():
        reference = scores.get((condition, AGAINST), {})
        shared = [unit for unit in ours if unit in reference]
        if method == AGAINST or not shared:
            continue
        by_setup = result.setdefault(condition, {}).setdefault(method, {})
        for unit in shared:
            by_setup.setdefault(unit[0], []).append(ours[unit] - reference[unit])
    return result


def _worst(runs: Sequence[Path], rows: Sequence[Row], address: dict[TrialKey, str]) -> list[WorstTrial]:
    """The worst of the reference method (of all, where it is not there), then trials of any method that failed."""
    ordered = worst_first(row.record for row in rows)
    first = ([record for record in ordered if record.key.method == AGAINST] or ordered)[:WORST]
    failed = [record for record in ordered if record.status in ("failed", "crashed") and record not in first][:WORST]
    listed = []
    for record in (*first, *failed):
        name = record.key.name
        run = next(run for run in runs if read_run(run).origin == record.key.origin)
        reached = "?" if record.fragments is None else str(record.fragments)
        listed.append(
            WorstTrial(
                name=name,
                status=record.status,
                reason=record.reason,
                iou_strict=record.iou_strict,
                fragments=f"{reached} of {record.goal_fragments}",
                command=f"cutgrammar view {run} {name}",
                recording=address.get(record.key),
            )
        )
    return listed


def _pictures(rows: Sequence[Row], files: dict[TrialKey, Path]) -> Iterable[Picture]:
    """Of every setup the recorded trials in turn, until there are enough; those of the reference method first."""
    recorded = [row.record for row in rows if row.record.key in files]
    turns: dict[str, int] = {}
    order = []
    for record in sorted(recorded, key=lambda record: (record.key.method != AGAINST, record.key.run, record.key)):
        turn = turns[record.key.setup] = turns.get(record.key.setup, -1) + 1
        order.append((turn, record))
    shown = 0
    for _, record in sorted(order, key=lambda pair: pair[0]):
        if shown == PICTURES:
            return
        configurations = configurations_of(files[record.key])
        if configurations is None or len(configurations[2]) != record.fragments:
            continue
        shown += 1
        title = f"{record.key.name}: strict IoU {record.iou_strict:.3f}, {record.status}"
        yield Picture(title, *configurations, pairs=[(int(i), int(j)) for i, j, _ in record.events[-1]["pairs"]])


def _provenance(runs: Sequence[Path]) -> list[tuple[str, str]]:
    found = []
    for run in runs:
        facts = read_run(run)
        found += [
            ("run", str(run)),
            ("seed", str(facts.seed)),
            ("cutgrammar", f"{facts.package}, commit {facts.commit or 'unknown'}"),
            ("data", f"{facts.data}, digest {facts.data_digest}"),
            ("split", f"{facts.split}, digest {facts.split_digest}"),
            ("model", f"{facts.model}, digest {facts.model_digest}"),
            ("settings", json.dumps(facts.settings, sort_keys=True)),
            ("machine", json.dumps(facts.machine, sort_keys=True)),
        ]
        if facts.missing:
            found.append(("trials missing from the data", ", ".join(map(str, facts.missing))))
    return found
