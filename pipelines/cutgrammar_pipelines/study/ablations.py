"""Ablations: train and evaluate every variant and transfer of a study, and sum them up beside its main evaluation.

Under the study's folder stand `ablations/models/NAME` and `ablations/runs/NAME` for each, `ablations/data/` for further
demonstrations, and the summary as `ablations.txt`, `ablations.json` and `ablations.html`. A variant that changes
nothing of the training uses the study's model. All of it resumes where it was.
"""

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.learning.learn import settings_used
from cutgrammar.learning.model import Model, load_model
from cutgrammar.settings import Settings
from cutgrammar.storage.run_folder import read_run
from cutgrammar_pipelines.reports.build import build_report, read_rows, write_report_page
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.train import train
from cutgrammar_pipelines.stages.training_data import OTHER_FOOD, SAME_FOOD, SPLIT, transfer_data, with_training_trials
from cutgrammar_pipelines.study.ablation_report import ablation_report
from cutgrammar_pipelines.study.ablation_table import Evaluated, ablation_table, oracle_table, transfer_table
from cutgrammar_pipelines.study.settings import StudySettings
from cutgrammar_pipelines.study.variants import Transfer, Variant, Variations
from cutgrammar_pipelines.tracking.logs import RunLog, flat
from cutgrammar_pipelines.tracking.mlflow_store import log_ablations, log_evaluation, log_training


@dataclass(frozen=True)
class Bench:
    """What variants of one study share.

    Attributes:
        out: the study's folder; `data`, `model` and `run` of its main evaluation stand in it.
        own: the study's settings.
        settings: those of its steps.
        workers, address: Ray actors, and a running cluster to join.
    """

    out: Path
    own: StudySettings
    settings: Settings
    workers: int
    address: str | None

    @property
    def folder(self) -> Path:
        """Where all that belongs to variants stands."""
        return self.out / "ablations"


def ablate(bench: Bench, variations: Variations) -> bool:
    """Carry out all variants and transfers, and write their summary.

    Args:
        bench: the study, its main evaluation done.
        variations: what to carry out.

    Returns:
        Whether no trial is missing.
    """
    whole, tried, carried = True, [], []
    for number, variant in enumerate(variations.variants, start=1):
        print(f"variant {number} of {len(variations.variants)}: {variant.asked.name} ({variant.asked.question})")
        one, complete = _variant(bench, variant)
        tried.append(one)
        whole = whole and complete
    for transfer in variations.transfers:
        print(f"transfer {transfer.name}: from {' and '.join(transfer.train_foods)} to others")
        both, complete = _transfer(bench, transfer)
        carried += both
        whole = whole and complete
    base = _evaluated("base", "", bench.out / "run", load_model(bench.out / "model"), {"changes": {}})
    summary = {
        "schema": 1,
        **ablation_table(base, tried),
        "oracles": oracle_table(base.rows),
        "transfers": transfer_table(carried),
    }
    _write(bench.out, summary)
    seconds = sum(row.record.seconds for one in (base, *tried, *carried) for row in one.rows)
    print(f"the trials in these tables took {seconds / 3600:.2f} hours of one worker each, trainings not counted")
    return whole


def _variant(bench: Bench, variant: Variant) -> tuple[Evaluated, bool]:
    asked, own = variant.asked, bench.own
    data, split = with_training_trials(
        bench.out / "data",
        asked.train_trials,
        bench.folder / "data",
        seed=own.seed,
        workers=bench.workers,
        address=bench.address,
        settings=bench.settings,
    )
    learns_alike = settings_used(variant.settings) == settings_used(bench.settings)
    if learns_alike and not asked.seed_offset and split == SPLIT:
        path = bench.out / "model"
    else:
        path = bench.folder / "models" / asked.name
        _train(data, path, own.seed + asked.seed_offset, variant.settings, split)
    run = bench.folder / "runs" / asked.name
    complete = _evaluate(bench, bench.out / "data", path, run, asked.methods, SPLIT, variant.settings)
    return _evaluated(asked.name, asked.question, run, load_model(path), {"changes": variant.changes}), complete


def _transfer(bench: Bench, transfer: Transfer) -> tuple[list[Evaluated], bool]:
    data = transfer_data(
        transfer,
        bench.folder / "data",
        seed=bench.own.seed,
        workers=bench.workers,
        address=bench.address,
        settings=bench.settings,
    )
    path = bench.folder / "models" / transfer.name
    _train(data, path, bench.own.seed, bench.settings, SAME_FOOD)
    found, whole = [], True
    for split, foods in ((SAME_FOOD, transfer.train_foods), (OTHER_FOOD, transfer.test_foods)):
        run = bench.folder / "runs" / f"{transfer.name}-{split}"
        done = _evaluate(bench, data, path, run, transfer.methods, split, bench.settings, transfer.test_trials)
        whole = whole and done
        tested = {"trained": " and ".join(transfer.train_foods), "tested": " and ".join(foods)}
        found.append(_evaluated(run.name, transfer.name, run, load_model(path), tested))
    return found, whole


def _train(data: Path, path: Path, seed: int, settings: Settings, split: str) -> None:
    """Train, tell MLflow, and say what it took."""
    before = time.process_time()
    trained = train(data, path, seed=seed, settings=settings, split=split)
    if trained.learned is not None:
        print(f"{path}: learned in {(time.process_time() - before) / 60:.1f} CPU-minutes")
    log_training(trained, data)


def _evaluate(
    bench: Bench,
    data: Path,
    model: Path,
    run: Path,
    methods: tuple[str, ...],
    split: str,
    settings: Settings,
    test_trials: int | None = None,
) -> bool:
    """Evaluate as the study does, tell MLflow, and return whether no trial is missing."""
    own = bench.own
    summary = evaluate(
        data,
        model,
        run,
        methods=methods,
        setups=own.setups if test_trials is None else None,
        runs=own.runs,
        trials=(own.test_trials if test_trials is None else test_trials) or None,
        goals=own.goals,
        world=own.world,
        workers=bench.workers,
        address=bench.address,
        seed=own.seed,
        settings=settings,
        split=split,
    )
    log_evaluation(run, build_report([run]))
    return summary.complete


def _evaluated(name: str, question: str, run: Path, model: Model, facts: Mapping[str, Any]) -> Evaluated:
    rows, _ = read_rows([run])
    learned = {
        "k": model.grammar.k,
        "training_trials": len(model.provenance.trials),
        "training_seed": model.provenance.seed,
    }
    return Evaluated(name, question, tuple(rows), {**learned, **facts})


def summary_log(out: Path, summary: Mapping[str, Any], files: Sequence[Path]) -> RunLog:
    """The summary of the study in folder `out` as one run for MLflow: a metric for every variant and method."""
    facts, metrics = read_run(out / "run"), {}
    for row in summary["rows"]:
        name = f"{row['variant']} {row['method']} {row['goals']}"
        metrics[f"iou_strict/{name}"] = row["iou_strict_mean"]
        if row["mean_difference"] is not None:
            metrics[f"difference/{name}"] = row["mean_difference"]
    for row in summary["transfers"]:
        metrics[f"iou_strict/{row['name']} {row['method']} {row['goals']}"] = row["iou_strict_mean"]
    return RunLog(
        name=f"ablations of {out.name}",
        identity={"ablations": out.name, "origin": facts.origin},
        params={"seed": facts.seed, **flat(facts.settings)},
        metrics=metrics,
        tags={
            "origin": facts.origin,
            "data": facts.data_digest,
            "model": facts.model_digest,
            "folder": str(out.resolve()),
        },
        files=tuple(files),
    )


def _write(out: Path, summary: dict[str, Any]) -> None:
    report = ablation_report(summary)
    write_atomic(out / "ablations.json", json_bytes(report.to_json()))
    write_atomic(out / "ablations.txt", (as_text(report, 120) + "\n").encode())
    write_report_page(report, out / "ablations.html")
    log_ablations(summary_log(out, summary, [out / f"ablations.{kind}" for kind in ("json", "txt", "html")]), out)
    print(as_text(report, shutil.get_terminal_size((100, 24)).columns))
    print(f"ablations   {out / 'ablations.html'}")
