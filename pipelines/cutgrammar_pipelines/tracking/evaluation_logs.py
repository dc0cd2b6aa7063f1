"""An evaluation as runs for MLflow."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes
from cutgrammar.methods.registry import describe_methods
from cutgrammar.results.report import DotChart, LineChart, Report, StripChart
from cutgrammar.results.score_table import MEAN, Row, means_of_rows
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import RunFacts, ledger_of, read_run
from cutgrammar.trials.record import Record
from cutgrammar_pipelines.tracking.run_log import KIND, METHOD, REPORT, RUN, Input, RunLog, flat

TOP = ("method", "world", "perception")
"""Fields of a trial's key that distinguish the top-level runs of an evaluation."""
IN_PLACE = "in-place"
"""The goal condition that metrics do not name, because it is that of Table I."""
COUNTED = ("failures", "stuck", "dead_ends", "human_rating_ratings", "human_rating_raters")
"""Fields of a report's row that are logged under their own names."""
KEY_COLUMNS = ("setup", "trial", "goals", "run")
RECORD_COLUMNS = ("status", "reason", "fragments", "goal_fragments", "cuts", "refusals", "dead_ends")
"""Columns of the table of trials, beside one for each score."""
SHOWN = 12
"""Digits of a digest that is shown among the settings."""


def evaluation_logs(
    run: Path, report: Report, files: Sequence[Path] = (), records: Sequence[Record] | None = None
) -> list[RunLog]:
    """One run for each method of the evaluation in folder `run`, with one for each seed in it; one for the report.

    Args:
        run: the run folder.
        report: of this run folder alone.
        files: further artifacts, e.g. the report as a page.
        records: of the run, where they are read already; what happened in them is not used.

    Raises:
        InputError: the run folder cannot be read.
    """
    facts = read_run(run)
    of_top = attrgetter(*(f"key.{name}" for name in TOP))
    records = read_records(ledger_of(run), events=False) if records is None else records
    groups = [(top, list(group)) for top, group in groupby(sorted(records, key=of_top), of_top)]
    numbers, identity = report.numbers, {"run": run.name, "origin": facts.origin}
    inputs = (Input(Path(facts.data).name, facts.data_digest, facts.data, "testing"),)
    several = len({top[1:] for top, _ in groups}) > 1
    logs = []
    for top, records in groups:
        name = _name(run, top, several)
        rows, means, tests = (
            [entry for entry in numbers[table] if itemgetter(*TOP)(entry) == top]
            for table in ("rows", "setup_means", "tests")
        )
        logs.append(
            RunLog(
                name=name,
                identity={**identity, "top": top},
                params={**dict(zip(TOP, top, strict=True)), **_shared_params(facts), **flat(facts.settings)},
                metrics=_metrics([*rows, *({**entry, "setup": MEAN} for entry in means)])
                | _comparisons(tests)
                | _agreement(numbers),
                tags={
                    **_tags(run, facts),
                    KIND: METHOD,
                    "goals": ", ".join(dict.fromkeys(row["goals"] for row in rows)),
                    "trials": str(len(records)),
                },
                inputs=inputs,
                texts={"trials.csv": _table(records)},
                description=_description(top[0]),
                children=tuple(_children(name, {**identity, "top": top}, records, facts)),
            )
        )
    report_json = json_bytes(report.to_json()).decode()
    logs.append(
        RunLog(
            name=f"report of {run.name}",
            identity={**identity, "part": REPORT},
            params={**_shared_params(facts), **flat(facts.settings)},
            tags={**_tags(run, facts), KIND: REPORT},
            inputs=inputs,
            texts={"report.json": report_json},
            drawn=partial(_figures, report),
            files=tuple(files),
        )
    )
    return logs


def _name(run: Path, top: tuple[str, ...], several: bool) -> str:
    """What a chart shows: the method, and what else tells it from the other runs of the study."""
    name = ", ".join(top if several else top[:1])
    return name if run.name == "run" else f"{name} ({run.name})"


def _children(name: str, identity: Mapping[str, Any], records: Sequence[Record], facts: RunFacts) -> Iterable[RunLog]:
    """One run for each seed or model; none for people, who do different goals and use no model."""
    if describe_methods([records[0].key.method])[0].is_person:
        return
    for number in sorted({record.key.run for record in records}):
        entries = means_of_rows(Row.of(record, facts) for record in records if record.key.run == number)
        yield RunLog(
            name=f"{name}: run {number}",
            identity={**identity, "seed": number},
            metrics=_metrics(entries),
            tags={
                KIND: RUN,
                "run": str(number),
                "method": records[0].key.method,
                "model": facts.model_digests[number if len(facts.model_digests) > 1 else 0],
            },
        )


def metric(section: str, goals: str, setup: str) -> str:
    """Name of a metric: `iou_strict/N1M1` for goals in place, `iou_strict/scattered/N1M1` for others.

    All before the last slash is the heading of a section in MLflow's chart page.
    """
    return "/".join((section, setup) if goals == IN_PLACE else (section, goals, setup))


def _metrics(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Every known number of a report's rows; scores that are not known yet, such as ratings, come with a later log."""
    metrics: dict[str, float] = {}
    for row in rows:
        for name, value in row.items():
            if value is None:
                continue
            if name.endswith("_ci95"):
                values = {f"{name}_low": value[0], f"{name}_high": value[1]}
            elif name.endswith(("_mean", "_std", "_std_runs", "_worst_run")) or name in COUNTED:
                values = {name.removesuffix("_mean"): value}
            else:
                continue
            metrics |= {metric(part, row["goals"], row["setup"]): float(number) for part, number in values.items()}
    return metrics


def _comparisons(tests: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """The differences from the reference methods and their corrected p-values."""
    return {
        metric(f"{section}_{test['against']}", test["goals"], test["setup"]): float(test[name])
        for test in tests
        for section, name in (("difference_from", "mean_difference"), ("p_against", "p_corrected"))
        if test[name] is not None
    }


def _agreement(numbers: Mapping[str, Any]) -> dict[str, float]:
    """Krippendorff's alpha of the people who have rated results of this evaluation, if it is known."""
    alpha = numbers.get("human_rating", {}).get("alpha")
    return {} if alpha is None else {"human_rating_alpha/all": float(alpha)}


def _shared_params(facts: RunFacts) -> dict[str, Any]:
    """What all methods of an evaluation share and other evaluations may not."""
    return {
        "seed": facts.seed,
        "split": facts.split,
        "data": f"{Path(facts.data).name} {facts.data_digest[:SHOWN]}",
        "models": ", ".join(digest[:SHOWN] for digest in facts.model_digests),
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


def _description(method: str) -> str:
    """What a method does, for the run's page."""
    (described,) = describe_methods([method])
    return described.description


def _figures(report: Report) -> dict[str, str]:
    """The charts of a report, as SVG files."""
    from cutgrammar_dashboards.report.charts import colours_of, draw_dots, draw_lines, draw_strips  # imports matplotlib

    colours = colours_of(report.series, report.dashed)
    figures: dict[str, str] = {}
    items = (item for section in report.sections for item in section.items)
    for number, figure in enumerate(one for item in items for one in (item if isinstance(item, tuple) else (item,))):
        salt = f"f{number}"
        if isinstance(figure, DotChart):
            drawn = draw_dots(figure, colours, salt)
        elif isinstance(figure, LineChart):
            drawn = draw_lines(figure, colours, report.dashed, salt)
        elif isinstance(figure, StripChart):
            drawn = draw_strips(figure, salt)
        else:
            continue
        figures[f"figures/{len(figures) + 1}.svg"] = drawn
    return figures


def _table(records: Sequence[Record]) -> str:
    """The trials as comma-separated values."""
    out = io.StringIO()
    scores = list(dict.fromkeys(name for record in records for name in record.scores))
    writer = csv.DictWriter(out, [*KEY_COLUMNS, *RECORD_COLUMNS, *scores], lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    for record in sorted(records, key=lambda record: record.key):
        writer.writerow({**asdict(record.key), **vars(record), **record.scores})
    return out.getvalue()
