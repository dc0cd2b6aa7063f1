"""The report of one or more runs: read their ledgers, build the report, write it as text, JSON, page, CSV or LaTeX."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError, listed
from cutgrammar.results.evaluation_report import evaluation_report
from cutgrammar.results.provenance_section import provenance_sections
from cutgrammar.results.report import Report
from cutgrammar.results.score_table import Row
from cutgrammar.storage.ledger import count_missing, read_attempts, read_records
from cutgrammar.storage.ratings import read_ratings
from cutgrammar.storage.run_folder import ledger_of, read_run, refuse_test_robots
from cutgrammar_pipelines.config import ReportConfig
from cutgrammar_pipelines.reports.beside import put_beside
from cutgrammar_pipelines.reports.latex import as_latex
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.reports.trial_details import detail_sections
from cutgrammar_pipelines.reports.trials_csv import as_csv
from cutgrammar_pipelines.stages.progress import stages, status

COMPARABLE = ("data_digest", "split_digest", "model_digests", "package", "settings")
"""Facts in which the runs of one report should agree; if they do not, the report has a note."""


@dataclass(frozen=True)
class RunRows:
    """What the ledgers of runs hold.

    Attributes:
        rows: each trial once.
        notes: about missing and differing rows.
        n_missing: planned trials that have no row, of all runs together.
    """

    rows: list[Row]
    notes: list[str]
    n_missing: int


def build_report(
    runs: Sequence[Path],
    timing: bool = True,
    against: Sequence[str] | None = None,
    trials: Sequence[str] = (),
    beside: Sequence[Path] = (),
    read: RunRows | None = None,
) -> Report:
    """The report of `runs`.

    Args:
        runs: folders that `evaluate` made.
        timing: include times; everything else is reproduced exactly by the same seeds.
        against: the methods that the others are tested against; the usual ones if None.
        trials: names of trials that a page shows in any case.
        beside: other runs, which are compared with `runs` trial by trial.
        read: what `read_rows` found in `runs`, where that is known already.

    Raises:
        InputError: a folder is not a run, its ledger or ratings are torn, or no run holds one of the methods
            `against` or one of the `trials`; or `runs` and `beside` have no trial in common.
    """
    read = read or read_rows(runs)
    rows = read.rows
    evaluated = sorted({row.record.key.method for row in rows})
    if unknown := [name for name in against or () if name not in evaluated]:
        raise InputError(f"no run has trials of {unknown[0]}, to test against; methods that have: {listed(evaluated)}")
    ratings = [rating for run in dict.fromkeys(runs) for rating in read_ratings(run)]
    others = read_rows(beside) if beside else RunRows([], [], 0)
    with stages() as watch:
        built = evaluation_report(
            rows,
            timing,
            [*read.notes, *others.notes],
            (
                *provenance_sections([read_attempts(ledger_of(run)) for run in (*runs, *beside)], timing),
                *detail_sections(runs, rows, () if beside else trials),
            ),
            against,
            ratings,
            lambda done, total: watch("report", done, total),
        )
    return put_beside(built, runs, rows, beside, others.rows, trials) if beside else built


def read_rows(runs: Sequence[Path]) -> RunRows:
    """The rows of `runs`.

    Raises:
        InputError: no run, a folder is not a run, or its ledger is torn.
    """
    if not runs:
        raise InputError("no run was named; give the folders that cutgrammar evaluate made")
    rows: dict[str, Row] = {}
    notes: list[str] = []
    n_missing = 0
    facts = [read_run(run) for run in runs]
    refuse_test_robots(dict(zip(runs, facts, strict=True)))
    for run, fact in zip(runs, facts, strict=True):
        records = read_records(ledger_of(run), condensed=True)
        absent = missing(run)
        n_missing += absent
        if absent:
            notes.append(
                f"{run.name} is incomplete: {absent} of {absent + len(records)} rows are missing; "
                "the same evaluate command resumes it"
            )
        if any(record.key.origin not in fact.origins for record in records):
            raise InputError(
                f"{run / 'run.json'} was changed since its trials were carried out; put a good copy in its place"
            )
        for record in records:
            other = rows.setdefault(record.key.digest, Row.of(record, fact)).record
            if other is not record and other.digest != record.digest:
                notes.append(f"{record.key.name} came out differently in {run.name} than in a run named before it")
    differing = [name for name in COMPARABLE if any(getattr(fact, name) != getattr(facts[0], name) for fact in facts)]
    if differing:
        names, facts_named = (
            ", ".join(run.name for run in runs),
            ", ".join(n.removesuffix("_digests").removesuffix("_digest") for n in differing),
        )
        notes.append(f"the runs {names} differ in {facts_named}; the tables contain the rows of all of them")
    return RunRows(list(rows.values()), notes, n_missing)


def report(config: ReportConfig) -> int:
    """Print the report of runs and write it to `config.out`, if given; return 0, or 1 where rows are missing."""
    out, timing = config.out, not config.no_timing
    read = read_rows(config.runs)
    built = build_report(config.runs, timing, config.against, config.trials or (), config.beside or (), read)
    if out is not None and out.suffix == ".html":
        write_report_page(built, out)
    elif out is not None:
        text = as_csv(read.rows, timing) if out.suffix == ".csv" else as_latex(built)
        out.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(out, text.encode())
    if config.json:
        print(json.dumps(built.to_json(), indent=2, allow_nan=False))
    else:
        print(as_text(built, shutil.get_terminal_size((100, 24)).columns))
        if out is not None:
            status(f"\nreport      {out}")
    return 1 if read.n_missing or any(map(missing, config.beside or ())) else 0


def missing(run: Path) -> int:
    """Number of trials planned for `run` that have no row."""
    return count_missing(ledger_of(run))


def write_report_page(built: Report, out: Path) -> None:
    """Write a report as a self-contained page to `out`."""
    from cutgrammar_dashboards.report.page import write_page  # matplotlib takes a second to import

    with stages() as watch:
        write_page(built, out, lambda done, total: watch("page", done, total))
