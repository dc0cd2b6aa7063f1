"""A whole study from one settings file: collect, split, train, evaluate, report. Each step resumes where it was."""

import shutil
from pathlib import Path

from cutgrammar_pipelines.reports.build import build_report, write_report_page
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.evaluate import check_names, evaluate
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import train
from cutgrammar_pipelines.study.ablations import Bench, ablate
from cutgrammar_pipelines.study.settings import load_study
from cutgrammar_pipelines.study.variants import load_variations
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, log_training, store_name


def study(out: Path, *, file: Path, workers: int, address: str | None = None, show: bool = False) -> int:
    """Do all steps of the study in `file` under `out`, then its variants; return 0, or 1 where trials are missing.

    Args:
        out: folder for data, model, run and report; what stands there from an earlier start is gone on with.
        file: the study's settings file.
        workers: Ray actors; 0 works in this process.
        address: a running Ray cluster to join.
        show: print the settings file and do nothing.
    """
    own, settings = load_study(file)
    variations = load_variations(file)
    if show:
        print(file.read_text(), end="")
        return 0
    check_names((*own.methods, *variations.methods), own.goals, own.world, own.record)
    data, model, run, page = out / "data", out / "model", out / "run", out / "report.html"
    collect(
        data,
        trials=own.trials,
        seed=own.seed,
        setups=own.setups,
        workers=workers,
        address=address,
        settings=settings,
    )
    split([data], data)
    seeing = own.perception == "cameras"
    log_training(train(data, model, seed=own.seed, settings=settings, vision=seeing), data)
    summary = evaluate(
        data,
        model,
        run,
        methods=own.methods,
        setups=own.setups,
        runs=own.runs,
        trials=own.test_trials or None,
        goals=own.goals,
        world=own.world,
        perception=own.perception,
        record=own.record,
        workers=workers,
        address=address,
        seed=own.seed,
        settings=settings,
    )
    report = build_report([run])
    write_report_page(report, page)
    log_evaluation(run, report, [page])
    print(as_text(report, width=shutil.get_terminal_size((100, 24)).columns))
    print(f"report      {page}")
    for recording in sorted((run / "recordings").glob("*.rrd"))[:1]:
        print(f"recordings  {recording.parent} (rerun {recording}; or cutgrammar view {run})")
    print(f"MLflow      {store_name()} (cutgrammar mlflow starts its page)")
    complete = summary.complete
    if variations:
        complete = ablate(Bench(out, own, settings, workers, address), variations) and complete
    return 0 if complete else 1
