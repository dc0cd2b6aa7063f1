"""The commands of `cutgrammar`: each is given its config and calls the function that does the work.

Libraries that take seconds to import are imported by the command that needs them, so that help is fast.
"""

from collections.abc import Callable
from typing import Annotated

from cyclopts import Parameter

from cutgrammar_pipelines import config as configs

Options = Parameter(name="*")
"""The fields of a config are the options of its command."""


def _collect(config: Annotated["configs.CollectConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.collect import collect

    collect(config)
    return 0


def _import(config: Annotated["configs.ImportConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.import_recorded import import_recorded

    import_recorded(config)
    return 0


def _record(config: Annotated["configs.RecordConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.record import record

    return record(config)


def _split(config: Annotated["configs.SplitConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.splitting import split

    split(config)
    return 0


def _train(config: Annotated["configs.TrainConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.train import train
    from cutgrammar_pipelines.tracking.mlflow_store import log_training
    from cutgrammar_pipelines.tracking.system_load import watch_system

    with watch_system() as history:
        trained = train(config)
    log_training(trained, config.data, history=history)
    return 0


def _evaluate(config: Annotated["configs.EvaluateConfig", Options]) -> int:
    from cutgrammar.command_lines import command_line
    from cutgrammar_pipelines.reports.reported import is_reported, note_reported
    from cutgrammar_pipelines.stages.evaluate import evaluate
    from cutgrammar_pipelines.stages.progress import status
    from cutgrammar_pipelines.tracking.mlflow_store import store_name

    summary = evaluate(config)
    if not summary.new and is_reported(config.out, store_name()):
        again = command_line("report", config.out), command_line("sync", config.out)
        status(
            f"nothing changed since its table was printed and logged; {again[0]} prints it, {again[1]} logs it again"
        )
        return 0 if summary.complete else 1

    from cutgrammar_pipelines.reports.build import build_report, read_rows
    from cutgrammar_pipelines.reports.text import as_text
    from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation

    read = read_rows([config.out])
    report = build_report([config.out], read=read)
    print(as_text(report))
    if log_evaluation(config.out, report, records=[row.record for row in read.rows]):
        note_reported(config.out, store_name())
    return 0 if summary.complete else 1


def _plan(config: Annotated["configs.PlanConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.plan import plan

    return plan(config)


def _rate(config: Annotated["configs.RateConfig", Options]) -> int:
    from cutgrammar_pipelines.stages.rate import rate

    return rate(config)


def _report(config: Annotated["configs.ReportConfig", Options]) -> int:
    from cutgrammar_pipelines.reports.build import report

    return report(config)


def _view(config: Annotated["configs.ViewConfig", Options]) -> int:
    from cutgrammar_pipelines.inspection.view import view

    return view(config)


def _film(config: Annotated["configs.FilmConfig", Options]) -> int:
    from cutgrammar_pipelines.inspection.film import film

    return film(config)


def _export(config: Annotated["configs.ExportConfig", Options]) -> int:
    from cutgrammar_pipelines.inspection.export import export

    return export(config)


def _show(config: Annotated["configs.ShowConfig", Options]) -> int:
    from cutgrammar_pipelines.inspection.show import show

    return show(config)


def _sync(config: Annotated["configs.SyncConfig", Options]) -> int:
    from cutgrammar_pipelines.reports.build import build_report
    from cutgrammar_pipelines.stages.progress import status
    from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, store_name

    if not log_evaluation(config.run, build_report([config.run]), is_patient=True):
        return 1
    status(f"{config.run}: its scores are in MLflow at {store_name()} (cutgrammar mlflow starts its page)")
    return 0


def _study(config: Annotated["configs.StudyConfig | None", Options] = None) -> int:
    from cutgrammar_pipelines.study.run import study

    return study(config or configs.StudyConfig())


def _mlflow(config: Annotated["configs.MlflowConfig | None", Options] = None) -> int:
    from cutgrammar_pipelines.tracking.serving import serve

    return serve(config or configs.MlflowConfig())


def _doctor() -> int:
    """Report which parts of cutgrammar work on this machine, and how to get those that do not.

    Example:
      cutgrammar doctor
    """
    from cutgrammar_pipelines.inspection.doctor import doctor

    return doctor()


_STAGES = (_collect, _import, _record, _split, _train, _evaluate, _rate, _plan)
_RESULTS = (_report, _view, _film, _export, _show, _sync)
COMMANDS: dict[str, Callable[..., int]] = {
    command.__name__.removeprefix("_"): command for command in (*_STAGES, *_RESULTS, _study, _mlflow, _doctor)
}
"""All commands by name, in the order of the help text."""
