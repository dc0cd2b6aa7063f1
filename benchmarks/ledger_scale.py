"""Time and memory of reports and of resuming finished runs on large ledgers.

Ledgers of about the wanted sizes are made by repeating all records of a real run, with their configurations, under new
numbers: of runs, or with `--by trial` of test trials, as a large data set has them. The records keep what happened in
their trials, so that they are as large as real ones. Each figure is of a process of its own. `resume` is the work on
the ledger (plan, keys, statuses, whether the table was printed before) without opening data set and models; `evaluate`
is the whole command on a finished run, for which RUN must hold one run of every trial that its command plans and none
of a method that needs one run only; `report` prints the table, and `page` writes the page. `--keep` keeps the pages.

For example: python benchmarks/ledger_scale.py run --sizes 10000 100000
"""

import argparse
import contextlib
import io
import json
import os
import shutil
import sqlite3
import sys
import tempfile
from pathlib import Path

from cutgrammar.storage import attempts
from cutgrammar.storage.ledger import Ledger, read_planned, read_records
from cutgrammar.storage.ledger_file import APPLICATION, KEY, RESULT, SCHEMA, TABLES
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.trials.record import TrialKey
from cutgrammar_pipelines.cli.main import main as main_of_cutgrammar
from cutgrammar_pipelines.config import ReportConfig
from cutgrammar_pipelines.reports.reported import is_reported, note_reported
from cutgrammar_pipelines.stages.evaluate.run_trials import _summary
from cutgrammar_pipelines.tracking.mlflow_store import store_name
from measures.cost import cost_in_own_process, cost_of

WHAT = ("resume", "evaluate", "report", "page")


def repeat_run(source: Path, out: Path, size: int, by: str) -> int:
    """Make a run of about `size` records from those of `source`; each repetition shifts their number `by`.

    Returns:
        The number of records.
    """
    out.mkdir()
    shutil.copy(source / "run.json", out)
    names = ("digest", *KEY)
    with sqlite3.connect(ledger_of(out)) as connection:
        connection.executescript(f"PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {SCHEMA};")
        connection.executescript(TABLES + attempts.TABLES)
        records = read_records(ledger_of(source))
        step = 1 + max(getattr(record.key, by) for record in records)
        size = round(size / len(records)) * len(records)
        connection.execute("ATTACH ? AS source", (str(ledger_of(source)),))
        connection.execute("INSERT INTO contents SELECT * FROM source.contents")
        copy = "INSERT INTO configurations SELECT ?, role, digest FROM source.configurations WHERE key = ?"
        for number in range(size):
            repetition, place = divmod(number, len(records))
            record = records[place]
            facts = {name: getattr(record.key, name) for name in KEY}
            facts[by] += repetition * step
            key = TrialKey(**facts)
            values = [getattr(key, name) for name in names]
            text = json.dumps(record.to_json() | {"key": facts}, sort_keys=True)
            row = (*values, *(getattr(record, name) for name in RESULT), text)
            connection.execute(f"INSERT INTO planned VALUES ({', '.join('?' * len(values))})", values)
            connection.execute(f"INSERT INTO records VALUES ({', '.join('?' * len(row))})", row)
            connection.execute(copy, (key.digest, record.key.digest))
        connection.execute("INSERT INTO versions (content) VALUES ('{}')")
        for digest, status in connection.execute("SELECT key, status FROM records").fetchall():
            connection.execute(
                "INSERT INTO attempts VALUES (?, 1, ?, NULL, NULL, NULL, NULL, NULL, 1, NULL)", (digest, status)
            )
    connection.close()
    return size


def resume(run: Path) -> None:
    """What `evaluate` does with the ledger of a finished run whose table was printed."""
    with sqlite3.connect(ledger_of(run)) as connection:
        keys = [TrialKey(*values) for values in connection.execute(f"SELECT {', '.join(KEY)} FROM planned")]
    connection.close()
    with Ledger(ledger_of(run)) as ledger:
        ledger.plan(keys)
        present = ledger.keys()
        ledger.attempts()
    assert all(key.digest in present for key in keys)
    assert _summary(run, keys, 0, 0).complete
    assert is_reported(run, store_name())


def evaluate(run: Path) -> None:
    """The whole command on a finished run whose table was printed."""
    facts, keys = read_run(run), read_planned(ledger_of(run))

    def all_of(name: str) -> list[str]:
        return sorted({getattr(key, name) for key in keys})

    words = ["evaluate", "--data", facts.data, "--model", *facts.models, "--out", str(run), "--seed", str(facts.seed)]
    words += ["--methods", *all_of("method"), "--setups", *all_of("setup"), "--goals", *all_of("goals")]
    words += ["--world", keys[0].world, "--runs", str(1 + max(key.run for key in keys)), "--workers", "0"]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main_of_cutgrammar(words) == 0
    assert "nothing changed since" in printed.getvalue(), printed.getvalue()


def measure(what: str, run: Path) -> None:
    """Do it in this process, and print what it cost as JSON."""

    def work() -> int:
        if what in ("resume", "evaluate"):
            {"resume": resume, "evaluate": evaluate}[what](run)
            return 0
        from cutgrammar_pipelines.reports.build import report  # takes memory that the others do not need

        page = run / "page.html" if what == "page" else None
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
        report(ReportConfig(runs=(run,), out=page))
        sys.stdout = sys.__stdout__
        return page.stat().st_size if page else 0

    print(json.dumps(cost_of(work)))


def main() -> None:
    """Make the runs, and measure each figure in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a real run")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000], help="numbers of records")
    parser.add_argument("--what", nargs="+", default=["resume", "report"], choices=WHAT)
    parser.add_argument("--by", default="run", choices=("run", "trial"), help="what repeated records differ in")
    parser.add_argument("--keep", type=Path, help="folder for the pages")
    parser.add_argument("--measure", choices=WHAT, help="measure this in this process")
    options = parser.parse_args()
    if options.measure:
        measure(options.measure, options.run)
        return
    print(f"{'records':>8} {'what':>8} {'CPU [s]':>8} {'time [s]':>9} {'MB':>6} page [MB]")
    for size in options.sizes:
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            count = repeat_run(options.run, run, size, options.by)
            note_reported(run, store_name())
            for what in options.what:
                facts = cost_in_own_process([__file__, str(run), "--measure", what])
                page = f"{facts['found'] / 1e6:9.2f}" if facts["found"] else ""
                row = f"{count:8} {what:>8} {facts['cpu']:8.1f} {facts['seconds']:9.1f} {facts['mb']:6.0f}"
                print(row + page, flush=True)
                if what == "page" and options.keep is not None:
                    options.keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(run / "page.html", options.keep / f"{options.by}-{count}.html")


if __name__ == "__main__":
    main()
