"""Pack a run's ledger into one small Parquet file, or print the report of such a file.

The file holds all of every record except its events and traceback, and the digest of the whole record. Its metadata
holds what the run was made from: seed, settings, digests, version, commit. After packing, the script builds the report
from the ledger and from the file, and checks that they are equal.

Run: python studies/export_ledger.py pack RUN FILE.parquet
     python studies/export_ledger.py report FILE.parquet [--json]
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pyarrow as pa
import pyarrow.parquet as pq

from cutgrammar.errors import InputError
from cutgrammar.events import deciding_score
from cutgrammar.results.evaluation_report import evaluation_report
from cutgrammar.results.report import Report
from cutgrammar.results.score_table import Row, table_of
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run, refuse_test_robots
from cutgrammar.trials.record import Record, TrialKey, nest_scores
from cutgrammar_pipelines.reports.build import missing
from cutgrammar_pipelines.reports.text import as_text

LEFT_OUT = ("events", "traceback")
PLACES = ("data", "models", "machine")
"""Facts of a run about the machine that made it, which are left out."""


def pack(run: Path, file: Path) -> None:
    """Write the ledger of `run` to `file`, and check that its report follows from it."""
    facts = read_run(run)
    refuse_test_robots({run: facts})
    if absent := missing(run):
        raise InputError(f"{run} is incomplete: {absent} trials are missing; resume it first")
    records = read_records(ledger_of(run))
    rows = []
    for record in records:
        content = record.to_json()
        scalars = {name: value for name, value in content.items() if name not in (*LEFT_OUT, "key")}
        rows.append({**content["key"], **scalars, "digest": record.digest})
    known = {name: value for name, value in dataclasses.asdict(facts).items() if name not in PLACES}
    table = pa.Table.from_pylist(rows).replace_schema_metadata({"run": json.dumps(known, sort_keys=True)})
    pq.write_table(table, file, compression="zstd", compression_level=19)
    before = table_of([Row.of(record, facts) for record in records])
    after = report_of(file).numbers
    if before != after:
        differing = [name for name in before if before[name] != after.get(name)]
        raise InputError(f"the report from {file} differs from that of {run} in {', '.join(differing)}")
    print(f"{file}: {len(records)} records, {file.stat().st_size / 1e6:.2f} MB; its report is the same")


def report_of(file: Path) -> Report:
    """The report of a packed ledger."""
    table = pq.read_table(file)
    run = json.loads(table.schema.metadata[b"run"])
    model = run["model_digests"][0] if "model_digests" in run else run["model_digest"]
    rows = [Row(record, run["data_digest"], record.model or model) for record in map(_record, table.to_pylist())]
    return evaluation_report(rows)


def _record(row: dict[str, Any]) -> Record:
    """A record with the fields that a report reads, and the digest of the whole record."""
    key = TrialKey(**{field.name: row.pop(field.name) for field in dataclasses.fields(TrialKey)})
    if "scores" not in row:
        row = nest_scores(row)
    row.setdefault("model", None)  # files of 0.2 did not hold it
    strict = deciding_score(row["scores"])
    return cast(Record, SimpleNamespace(key=key, iou_strict=strict, **row))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    packing = commands.add_parser("pack")
    packing.add_argument("run", type=Path)
    packing.add_argument("file", type=Path)
    reporting = commands.add_parser("report")
    reporting.add_argument("file", type=Path)
    reporting.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    try:
        if chosen.command == "pack":
            pack(chosen.run, chosen.file)
        else:
            report = report_of(chosen.file)
            print(json.dumps(report.to_json(), indent=2) if chosen.json else as_text(report))
    except InputError as error:
        sys.exit(str(error))
