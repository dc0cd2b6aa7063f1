"""Ablations: train and evaluate every variant and transfer of a study, and compare them with its main evaluation.

The study's folder holds `ablations/models/NAME` and `ablations/runs/NAME` for each, `ablations/data/` for further
demonstrations, and the summary as `ablations.txt`, `ablations.json` and `ablations.html`. A variant with the same
training uses the study's model, the first of several; then variants are compared with its run alone. Every step resumes
where it stopped.
"""

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.learning.model import Model, load_model
from cutgrammar.learning.settings_used import settings_used
from cutgrammar.storage.run_folder import read_run
from cutgrammar_pipelines.config import TrainConfig
from cutgrammar_pipelines.reports.build import build_report, missing, read_rows, write_report_page
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.progress import status
from cutgrammar_pipelines.stages.train import train
from cutgrammar_pipelines.stages.training_data import OTHER_FOOD, SAME_FOOD, SPLIT, transfer_data, with_training_trials
from cutgrammar_pipelines.study.ablation_report import ablation_report
from cutgrammar_pipelines.study.ablation_table import Evaluated, ablation_table, oracle_table, transfer_table
from cutgrammar_pipelines.study.study_file import Study
from cutgrammar_pipelines.study.variants import Transfer, Variant
from cutgrammar_pipelines.tracking.mlflow_store import log_ablations, log_evaluation, log_training
from cutgrammar_pipelines.tracking.run_log import KIND, REPORT, RunLog, flat
from cutgrammar_pipelines.tracking.run_log import Study as Experiment


def ablate(study: Study) -> bool:
    """Carry out all variants and transfers of a study whose main evaluation is done, and write their summary.

    Returns:
        Whether all trials have a record.
    """
    variants: list[Evaluated] = []
    transfers: list[Evaluated] = []
    for number, variant in enumerate(study.variations.variants, start=1):
        options = variant.options
        status(f"variant {number} of {len(study.variations.variants)}: {options.name} ({options.question})")
        variants.append(_variant(study, variant))
    for transfer in study.variations.transfers:
        status(f"transfer {transfer.name}: from {' and '.join(transfer.train_foods)} to others")
        transfers += _transfer(study, transfer)
    base = _evaluated("base", "", study.evaluate.out, load_model(study.train.out), {"changes": {}})
    summary = {
        "schema": 1,
        **ablation_table(base, variants),
        "oracles": oracle_table(base.rows),
        "transfers": transfer_table(transfers),
    }
    _write(study.out, summary)
    seconds = sum(row.record.seconds for evaluated in (base, *variants, *transfers) for row in evaluated.rows)
    status(f"the trials in these tables took {seconds / 3600:.2f} hours of one worker each, without training")
    return not any(missing(_run_of(study, evaluated.name)) for evaluated in (*variants, *transfers))


def _variant(study: Study, variant: Variant) -> Evaluated:
    options = variant.options
    data, split = with_training_trials(study.collect, options.train_trials, study.ablations / "data")
    same_training = settings_used(variant.settings) == settings_used(study.settings)
    if same_training and not options.seed_offset and split == SPLIT:
        model = study.train.out
    else:
        model = study.ablations / "models" / options.name
        seed = study.train.seed + options.seed_offset
        _train(
            study, replace(study.train, data=str(data), out=model, seed=seed, settings=variant.settings, split=split)
        )
    run = _run_of(study, options.name)
    _evaluate(study, model=model, out=run, methods=options.methods, split=SPLIT, settings=variant.settings)
    return _evaluated(options.name, options.question, run, load_model(model), {"changes": variant.changes})


def _transfer(study: Study, transfer: Transfer) -> list[Evaluated]:
    data = transfer_data(study.collect, transfer, study.ablations / "data")
    model = study.ablations / "models" / transfer.name
    _train(study, replace(study.train, data=str(data), out=model, split=SAME_FOOD))
    result = []
    for split, foods in ((SAME_FOOD, transfer.train_foods), (OTHER_FOOD, transfer.test_foods)):
        run = _run_of(study, f"{transfer.name}-{split}")
        _evaluate(
            study,
            data=data,
            model=model,
            out=run,
            methods=transfer.methods,
            goals=transfer.goals or study.evaluate.goals,
            setups=None,
            trials=transfer.test_trials or None,
            split=split,
        )
        tested = {"trained": " and ".join(transfer.train_foods), "tested": " and ".join(foods)}
        result.append(_evaluated(run.name, transfer.name, run, load_model(model), tested))
    return result


def _run_of(study: Study, name: str) -> Path:
    return study.ablations / "runs" / name


def _train(study: Study, config: TrainConfig) -> None:
    """Train a model that sees the true fragments, log it to MLflow, and print the CPU time."""
    before = time.process_time()
    trained = train(replace(config, vision=False))
    if trained.learned is not None:
        status(f"{config.out}: trained in {(time.process_time() - before) / 60:.1f} CPU-minutes")
    log_training(trained, config.data, _experiment(study.out))


def _evaluate(study: Study, **changes: Any) -> None:
    """Evaluate one model as the study does, with `changes`, and log it to MLflow."""
    model = changes.pop("model")
    runs = study.evaluate.runs if len(study.trainings) == 1 else 1
    config = replace(
        study.evaluate, model=(model,), runs=runs, perception="truth", planners=1, record="none", **changes
    )
    evaluate(config)
    log_evaluation(config.out, build_report([config.out]), study=_experiment(study.out))


def _experiment(out: Path) -> Experiment:
    """The experiment of the variants and transfers of the study in folder `out`, apart from its own."""
    base = read_run(out / "run").data_digest
    return Experiment(f"{out.resolve().name} ablations", base)


def _evaluated(name: str, question: str, run: Path, model: Model, facts: Mapping[str, Any]) -> Evaluated:
    learned = {
        "k": model.grammar.k,
        "training_trials": len(model.provenance.trials),
        "training_seed": model.provenance.seed,
    }
    return Evaluated(name, question, tuple(read_rows([run]).rows), {**learned, **facts})


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
            KIND: REPORT,
            "origin": facts.origin,
            "data": facts.data_digest,
            "model": facts.model_digests[0],
            "folder": str(out.resolve()),
        },
        files=tuple(files),
    )


def _write(out: Path, summary: dict[str, Any]) -> None:
    report = ablation_report(summary)
    write_atomic(out / "ablations.json", json_bytes(report.to_json()))
    write_atomic(out / "ablations.txt", (as_text(report, 120) + "\n").encode())
    write_report_page(report, out / "ablations.html")
    files = [out / f"ablations.{kind}" for kind in ("json", "txt", "html")]
    log_ablations(summary_log(out, summary, files), out, _experiment(out))
    print(as_text(report, shutil.get_terminal_size((100, 24)).columns))
    print(f"ablations   {out / 'ablations.html'}")
