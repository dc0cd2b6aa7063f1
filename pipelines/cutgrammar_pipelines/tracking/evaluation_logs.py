"""An evaluation as runs for MLflow."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes
from cutgrammar.results.report import Report
from cutgrammar.results.score_table import Row, table_of
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import RunFacts, ledger_of, read_run
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.tracking.run_log import Input, RunLog, flat

CONDITION = ("method", "goals", "world", "perception")
"""Fields of a trial's key that name a top-level run."""
COUNTED = ("failures", "stuck", "dead_ends")
"""Fields of a report's row that are logged under their own names."""
KEY_COLUMNS = ("setup", "trial", "run")
RECORD_COLUMNS = ("status", "reason", "fragments", "goal_fragments", "cuts", "refusals", "dead_ends")
"""Columns of the table of trials, beside one for each score."""


def evaluation_logs(run: Path, report: Report, files: Sequence[Path] = ()) -> list[RunLog]:
    """One run for each method and condition of the evaluation in folder `run`, its seeds as children.

    Args:
        run: the run folder.
        report: of this run folder alone.
        files: further artifacts, e.g. the report as a page.

    Raises:
        InputError: the run folder cannot be read.
    """
    facts = read_run(run)
    report_json = json_bytes(report.to_json()).decode()
    by_condition = attrgetter(*(f"key.{name}" for name in CONDITION))
    logs = []
    for condition, group in groupby(sorted(read_records(ledger_of(run)), key=by_condition), by_condition):
        records, name = list(group), " ".join(condition)
        rows = [row for row in report.numbers["rows"] if itemgetter(*CONDITION)(row) == condition]
        tests = [test for test in report.numbers["tests"] if itemgetter(*CONDITION)(test) == condition]
        identity = {"run": run.name, "origin": facts.origin, "condition": condition}
        children = [
            RunLog(
                name=f"{name}: run {number}",
                identity={**identity, "seed": number},
                metrics=_metrics(table_of(Row.of(r, facts) for r in records if r.key.run == number)["rows"]),
                tags={
                    "run": str(number),
                    "method": records[0].key.method,
                    "model": facts.model_digests[number if len(facts.model_digests) > 1 else 0],
                },
            )
            for number in sorted({record.key.run for record in records})
        ]
        logs.append(
            RunLog(
                name=name,
                identity=identity,
                params={
                    **dict(zip(CONDITION, condition, strict=True)),
                    "seed": facts.seed,
                    "split": facts.split,
                    **flat(facts.settings),
                },
                metrics=_metrics(rows) | _comparisons(tests),
                tags=_tags(run, facts),
                inputs=(Input(Path(facts.data).name, facts.data_digest, facts.data, "testing"),),
                texts={"trials.csv": _table(records), "report.json": report_json},
                files=tuple(files),
                children=tuple(children),
            )
        )
    return logs


def _metrics(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Every known number, named SECTION/SETUP, so that MLflow's chart page has a section for each score."""
    metrics: dict[str, float] = {}
    for row in rows:
        for name, value in row.items():
            if value is None:
                continue
            if name.endswith("_ci95"):
                values = {f"{name}_low": value[0], f"{name}_high": value[1]}
            elif name.endswith(("_mean", "_std_runs", "_worst_run")) or name in COUNTED:
                values = {name.removesuffix("_mean"): value}
            else:
                continue
            metrics |= {f"{section}/{row['setup']}": float(number) for section, number in values.items()}
    return metrics


def _comparisons(tests: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """The differences from the reference methods and their corrected p-values, named SECTION/SETUP."""
    return {
        f"{section}_{test['against']}/{test['setup']}": float(test[name])
        for test in tests
        for section, name in (("difference_from", "mean_difference"), ("p_against", "p_corrected"))
        if test[name] is not None
    }


def _tags(run: Path, facts: RunFacts) -> dict[str, str]:
    tags = {
        "evaluation": run.name,
        "folder": str(run.resolve()),
        "origin": facts.origin,
        "data": facts.data_digest,
        "model": ", ".join(facts.model_digests),
        "split_digest": facts.split_digest,
        "cutgrammar": facts.package,
    }
    return tags | ({"commit": facts.commit} if facts.commit else {})


def _table(records: Sequence[Record]) -> str:
    """The trials as comma-separated values."""
    out = io.StringIO()
    scores = list(dict.fromkeys(name for record in records for name in record.scores))
    writer = csv.DictWriter(out, [*KEY_COLUMNS, *RECORD_COLUMNS, *scores], lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    for record in sorted(records, key=lambda record: record.key):
        writer.writerow({**asdict(record.key), **vars(record), **record.scores})
    return out.getvalue()
