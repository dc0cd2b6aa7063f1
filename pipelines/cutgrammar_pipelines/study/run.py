"""A whole study from one settings file: collect, split, train, evaluate, report. Every step can be resumed."""

import shutil
from shlex import quote

from cutgrammar.command_lines import command_line, program
from cutgrammar.storage.run_folder import recordings_of
from cutgrammar_pipelines.config import StudyConfig
from cutgrammar_pipelines.reports.build import build_report, write_report_page
from cutgrammar_pipelines.reports.text import as_text
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_pipelines.stages.progress import status
from cutgrammar_pipelines.stages.splitting import split
from cutgrammar_pipelines.stages.train import train_repeatedly
from cutgrammar_pipelines.study.ablations import ablate
from cutgrammar_pipelines.study.study_file import file_of, load_study
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, log_training, store_name
from cutgrammar_pipelines.tracking.system_load import watch_system


def study(config: StudyConfig) -> int:
    """Carry out all steps of a study, then its variants; return 0, or 1 if trials are missing.

    Raises:
        InputError: the settings file or one of the folders cannot be used.
    """
    steps = load_study(config)
    if config.print:
        print(file_of(config).read_text(), end="")
        return 0
    run, page = steps.evaluate.out, steps.out / "report.html"
    collect(steps.collect)
    split(steps.split)
    with watch_system() as history:
        train_repeatedly(
            steps.trainings,
            lambda trained: log_training(trained, steps.train.data, history=history),
            config.workers,
            config.address,
            config.py_module,
        )
    complete = evaluate(steps.evaluate).complete
    report = build_report([run])
    write_report_page(report, page)
    log_evaluation(run, report, [page])
    print(as_text(report, width=shutil.get_terminal_size((100, 24)).columns))
    status(f"report      {page}")
    for recording in sorted(recordings_of(run))[:1]:
        shown = f"{program('rerun')} {quote(str(recording))}; or {command_line('view', run)}"
        status(f"recordings  {recording.parent} ({shown})")
    status(f"MLflow      {store_name()} (cutgrammar mlflow starts its page)")
    if steps.variations:
        complete = ablate(steps) and complete
    return 0 if complete else 1
