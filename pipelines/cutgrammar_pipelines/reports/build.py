"""The report of one or more runs: read their ledgers, make the table, write it as text, JSON or a page."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar.results.score_table import Row, table_of
from cutgrammar.storage.ledger import read_planned, read_records
from cutgrammar.storage.run_folder import RunFacts, ledger_of, read_run
from cutgrammar_pipelines.reports.text import as_text

ALIKE = ("data_digest", "split_digest", "model_digest", "package", "settings")
"""Facts that runs put into one table should share; where they do not, the report says so."""


def build_report(runs: Sequence[Path], timing: bool = True) -> dict[str, Any]:
    """The scores of `runs` as one JSON object: `{"schema": 1, "rows": [...], "tests": [...], ...}` (see `table_of`).

    What a reader must know of the rows (some are missing, runs that differ) stands under "notes"; there is none where
    all is well.

    Args:
        runs: folders that `evaluate` made.
        timing: give times too; all else is reproduced exactly by the same seeds.

    Raises:
        InputError: a folder is not a run, or its ledger is torn.
    """
    rows, notes = read_rows(runs)
    report = table_of(rows, timing)
    return report | {"notes": notes} if notes else report


def read_rows(runs: Sequence[Path]) -> tuple[list[Row], list[str]]:
    """The rows of `runs`, each trial once, and what is to be said of them.

    Raises:
        InputError: no run, a folder is not a run, or its ledger is torn.
    """
    if not runs:
        raise InputError("no run was named; give the folders that cutgrammar evaluate made")
    found: dict[str, Row] = {}
    notes: list[str] = []
    facts = [read_run(run) for run in runs]
    for run, fact in zip(runs, facts, strict=True):
        records = read_records(ledger_of(run))
        if absent := missing(run):
            notes.append(
                f"{run.name} is incomplete: {absent} of {absent + len(records)} rows are missing; "
                "the same evaluate command goes on with it"
            )
        for record in records:
            other = found.setdefault(record.key.digest, Row(record, fact.data_digest)).record
            if other is not record and other.digest != record.digest:
                notes.append(f"{record.key.name} came out differently in {run.name} than in a run named before it")
    return list(found.values()), notes + _differences(runs, facts)


def _differences(runs: Sequence[Path], facts: Sequence[RunFacts]) -> list[str]:
    """What sets the runs apart but their seeds."""
    names = [name for name in ALIKE if any(getattr(fact, name) != getattr(facts[0], name) for fact in facts)]
    if not names:
        return []
    what = ", ".join(name.removesuffix("_digest") for name in names)
    return [
        f"the runs {', '.join(run.name for run in runs)} differ in {what}; their rows stand in one table all the same"
    ]


def report(runs: Sequence[Path], as_json: bool = False, timing: bool = True, out: Path | None = None) -> int:
    """Print the report of `runs` and, with `out`, write it as a page; return 0, or 1 where rows are missing."""
    built = build_report(runs, timing)
    if out is not None:
        write_report_page(runs, built, out)
    if as_json:
        print(json.dumps(built, indent=2, allow_nan=False))
    else:
        print(as_text(built, shutil.get_terminal_size((100, 24)).columns))
        if out is not None:
            print(f"\nreport      {out}")
    return 1 if any(missing(run) for run in runs) else 0


def missing(run: Path) -> int:
    """How many of the trials planned for `run` have no row."""
    there = {record.key.digest for record in read_records(ledger_of(run))}
    return len({key.digest for key in read_planned(ledger_of(run))} - there)


def write_report_page(runs: Sequence[Path], built: dict[str, Any], out: Path) -> None:
    """Write the report `built` of `runs` as a self-contained page to `out`, with figures and the worst trials.

    Pictures are drawn of trials that were recorded.
    """
    # Drawing needs matplotlib and rerun, which take a second or two to import: only who wants a page waits for them.
    from cutgrammar_dashboards.report.page import write_page
    from cutgrammar_pipelines.reports.page_details import details_of

    rows, _ = read_rows(runs)
    write_page(built, out, "Cutting objects into fragments: scores", details_of(runs, rows, out))
