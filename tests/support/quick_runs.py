"""Evaluations of few trials on the bench, which take a second."""

from pathlib import Path

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.evaluate.run_trials import Summary

QUICK = {"methods": ["random"], "setups": ["N1M1"], "runs": 1, "trials": 1, "world": "bench", "workers": 0}


def run_quick(given: Path, run: Path, **changes: object) -> Summary:
    """Evaluate one trial of `random`, but for the changes, with the data set and model of the folder `given`."""
    return evaluate(
        EvaluateConfig(**({"data": given / "data", "model": given / "model", "out": run} | QUICK | changes))
    )


def digests(run: Path) -> dict[str, str]:
    """Name of a trial -> digest of its record."""
    return {record.key.name: record.digest for record in read_records(ledger_of(run))}
