"""The whole command `evaluate`, and the same again when the run is finished: what it reads and what it imports."""

import json
import os
import subprocess
import sys

import pytest

COMMAND = """
import json, sqlite3, sys
asked, connect = [], sqlite3.connect

def traced(*arguments, **options):
    connection = connect(*arguments, **options)
    connection.set_trace_callback(asked.append)
    return connection

sqlite3.connect = traced
from cutgrammar_pipelines.cli.main import main
code = main(sys.argv[1:])
print(json.dumps({
    "code": code,
    "texts": sum("CAST(" in text and "FROM records" in text for text in asked),
    "checks": sum("quick_check" in text for text in asked),
    "imported": sorted({"torch", "ray", "mlflow", "sapien", "matplotlib", "rerun"} & set(sys.modules)),
}))
"""


@pytest.mark.slow
def test_a_command_scans_the_ledger_once_and_a_finished_run_imports_nothing_heavy(given, run, tmp_path):
    words = ["--data", given / "data", "--model", given / "model", "--out", run, "--methods", "random", "halve"]
    words += ["--world", "bench", "--trials", 1, "--runs", 1, "--workers", 0]
    environment = {**os.environ, "MLFLOW_TRACKING_URI": f"sqlite:///{tmp_path / 'mlflow.db'}"}

    def evaluate():
        command = [sys.executable, "-c", COMMAND, "evaluate", *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        return json.loads(done.stdout.splitlines()[-1]), done.stdout

    first, printed = evaluate()
    assert (first["code"], first["texts"], first["checks"]) == (0, 1, 1)
    assert "halve" in printed
    again, printed = evaluate()
    assert again == {"code": 0, "texts": 0, "checks": 1, "imported": []}
    assert "already finished" in printed
    assert "nothing changed since its table was printed and logged" in printed
