"""What MLflow is given about a training and an evaluation, as plain values: pure functions of files.

A training is one run for each of its parts (encoder, induction, classifier, planes, the baselines' bc, qnet and
goal_planes, and segmentation if vision was trained). An evaluation is one top-level run for each method and
condition, which carries `iou_strict/N1M1` and its like, so that MLflow's chart page is Table I; its runs (seeds) are
children. There is no run per trial, because the comparison page is slow with more than a hundred runs.
"""

import csv
import hashlib
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutgrammar.atomic_files import json_bytes
from cutgrammar.grammar.text import describe
from cutgrammar.results.report import Report
from cutgrammar.results.score_table import Row, table_of
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import RunFacts, ledger_of, read_run
from cutgrammar.trials.record import Record

if TYPE_CHECKING:  # torch takes seconds to import, and evaluations do without it
    from cutgrammar.learning.learn import Learned
    from cutgrammar.learning.model import Model

TRAINING, EVALUATION, ABLATIONS = "cutgrammar training", "cutgrammar evaluation", "cutgrammar ablations"
"""Names of the experiments."""
COUNTED = ("failures", "stuck", "dead_ends")
"""Fields of a report's row that are logged under their own names."""
TRIAL_COLUMNS = (
    "setup",
    "trial",
    "run",
    "status",
    "reason",
    "fragments",
    "goal_fragments",
    "cuts",
    "refusals",
    "dead_ends",
)
"""Columns of the table of trials, beside one for each score."""


@dataclass(frozen=True)
class Input:
    """A data set that something was made from.

    Attributes:
        name: to show.
        digest: sha256 of it.
        place: its path.
        context: what it was used for, e.g. "training".
    """

    name: str
    digest: str
    place: str
    context: str


@dataclass(frozen=True)
class RunLog:
    """One run of an experiment.

    Attributes:
        name: to show.
        identity: what makes it this run and no other; logging the same identity again updates it.
        params: settings, by name.
        metrics: single numbers, by name.
        curves: name -> (step, value) pairs.
        tags: digests and names, to filter by.
        inputs: the data sets it was made from.
        texts: file name -> content.
        files: to be copied.
        children: runs within this one.
    """

    name: str
    identity: Mapping[str, Any]
    params: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    curves: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)
    tags: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[Input, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    children: tuple["RunLog", ...] = ()

    @property
    def key(self) -> str:
        """Digest of the identity."""
        return hashlib.sha256(json_bytes(self.identity)).hexdigest()

    @property
    def content(self) -> str:
        """Digest of everything that is logged."""
        told = asdict(replace(self, files=(), children=())) | {
            "files": [[file.name, hashlib.sha256(file.read_bytes()).hexdigest()] for file in self.files],
            "children": [child.content for child in self.children],
        }
        return hashlib.sha256(json_bytes(told)).hexdigest()


def training_logs(path: Path, model: "Model", learned: "Learned | None", data: Path) -> list[RunLog]:
    """One run for each part of a training; numbers that are not finite are left out.

    Args:
        path: folder of the model.
        model: the model in it.
        learned: the history of its training, if that is still known.
        data: folder of the data set it was trained on.
    """
    came, settings = model.provenance, model.settings
    curves = _training_curves(learned) if learned else {}
    by_k: dict[str, list[tuple[int, float]]] = {}
    for point in model.induction.get("curve", ()):
        for name, value in point.items():
            if name != "k" and value is not None:
                by_k.setdefault(f"over_k/{name}", []).append((point["k"], value))
    texts = {
        "grammar.txt": describe(model.grammar),
        "gammas.json": json_bytes(model.induction.get("gammas", [])).decode(),
    }
    held_out: dict[str, tuple[Any, str]] = {
        "classifier": (settings.classifier, "classifier.safetensors"),
        "planes": (settings.planes, "planes.safetensors"),
        "bc": (settings.baselines, "bc.safetensors"),
        "qnet": (settings.baselines, "qnet.safetensors"),
        "goal_planes": (settings.baselines, "goal_planes.safetensors"),
    }
    parts: dict[str, dict[str, Any]] = {
        "encoder": {
            "params": asdict(settings.features),
            "curves": {"loss": _epochs(curves.get("encoder", ()))},
            "file": "encoder.safetensors",
        },
        "induction": {"params": asdict(settings.induction), "curves": by_k, "file": "grammar.json", "texts": texts},
    }
    for name, (params, file) in held_out.items():
        told = {"held_out_loss": _epochs(curves.get(name, ()))}
        parts[name] = {"params": asdict(params), "curves": told, "file": file}
    if model.segmentation is not None:
        losses = {name: _epochs(curves.get(f"segmentation_{name}", ())) for name in ("loss", "held_out_loss")}
        told = {name: curve for name, curve in losses.items() if curve or name == "loss"}
        parts["segmentation"] = {"params": asdict(settings.vision), "curves": told, "file": "segmentation.safetensors"}
    own = {name: [metric for metric in model.metrics if metric.startswith(f"{name}_")] for name in parts}
    own["induction"] = ["fragments", "cuts", "k", "gamma", "productions"]
    return [
        RunLog(
            name=f"{name} of {path.name}",
            identity={"model": model.digest, "part": name},
            params={"seed": came.seed, "split": came.split, **part["params"]},
            metrics={metric: model.metrics[metric] for metric in own[name] if metric in model.metrics},
            curves=part["curves"],
            tags={
                "part": name,
                "model": model.digest,
                "data": came.data,
                "split_digest": came.split_digest,
                "cutgrammar": came.package,
                "folder": str(path.resolve()),
            },
            inputs=(Input(data.name, came.data, str(data.resolve()), "training"),),
            texts=part.get("texts", {}) | _curve_picture(f"{name} of {path.name}", part["curves"], model),
            files=(path / part["file"],),
        )
        for name, part in parts.items()
    ]


def _training_curves(learned: "Learned") -> dict[str, Sequence[float]]:
    """Loss after each epoch, by part: of the encoder in training, of all others held out."""
    baselines = learned.baselines
    return {
        "encoder": learned.encoder_losses,
        "classifier": learned.classifier.losses,
        "planes": learned.planes.losses,
        **{method: found.losses for method, found in baselines.choices.items()},
        "goal_planes": baselines.cutting.losses,
        "segmentation_loss": learned.segmentation.losses if learned.segmentation else (),
        "segmentation_held_out_loss": learned.segmentation.held_out_losses if learned.segmentation else (),
    }


def _curve_picture(title: str, curves: Mapping[str, Sequence[tuple[int, float]]], model: "Model") -> dict[str, str]:
    """The curves of a part as a drawing; nothing where they are not known."""
    from cutgrammar_dashboards.figures.curves import draw_induction, draw_losses  # matplotlib takes a second to import
    from cutgrammar_dashboards.figures.layout.sheet import sheet_bytes

    if any(name.startswith("over_k/") for name in curves):
        figure = draw_induction(model.induction["curve"], model.grammar.k, title)
    elif any(curves.values()):
        figure = draw_losses(curves, title)
    else:
        return {}
    return {"curves.svg": sheet_bytes(figure, "svg").decode()}


def _epochs(losses: Sequence[float]) -> list[tuple[int, float]]:
    return [(epoch, loss) for epoch, loss in enumerate(losses, start=1) if math.isfinite(loss)]


def evaluation_logs(run: Path, report: Report, files: Sequence[Path] = ()) -> list[RunLog]:
    """One run for each method and condition of the evaluation in folder `run`, its seeds as children.

    Args:
        run: the run folder.
        report: of this run folder alone.
        files: further artifacts, e.g. the report as a page.

    Raises:
        InputError: the run folder cannot be read.
    """
    facts = read_run(run)
    records = sorted(read_records(ledger_of(run)), key=_condition)
    text = json_bytes(report.to_json()).decode()
    logs = []
    for condition, group in groupby(records, key=_condition):
        of_condition = list(group)
        method, goals, world, perception = condition
        rows = [row for row in report.numbers["rows"] if _condition_of_row(row) == condition]
        identity = {"run": run.name, "origin": facts.origin, "condition": condition}
        children = [
            RunLog(
                name=f"{method} {goals} {world} {perception}: run {number}",
                identity={**identity, "seed": number},
                metrics=_metrics(
                    table_of([Row(r, facts.data_digest) for r in of_condition if r.key.run == number])["rows"]
                ),
                tags={"run": str(number), "method": method},
            )
            for number in sorted({record.key.run for record in of_condition})
        ]
        logs.append(
            RunLog(
                name=f"{method} {goals} {world} {perception}",
                identity=identity,
                params={
                    "method": method,
                    "goals": goals,
                    "world": world,
                    "perception": perception,
                    "seed": facts.seed,
                    "split": facts.split,
                    **flat(facts.settings),
                },
                metrics=_metrics(rows),
                tags=_tags(run, facts),
                inputs=(Input(Path(facts.data).name, facts.data_digest, facts.data, "testing"),),
                texts={"trials.csv": _table(of_condition), "report.json": text},
                files=tuple(files),
                children=tuple(children),
            )
        )
    return logs


def flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one, e.g. {"search": {"rounds": 50}} as {"search.rounds": 50}."""
    result: dict[str, Any] = {}
    for name, value in tables.items():
        result |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return result


def _condition(record: Record) -> tuple[str, str, str, str]:
    key = record.key
    return key.method, key.goals, key.world, key.perception


def _condition_of_row(row: Mapping[str, Any]) -> tuple[str, str, str, str]:
    return row["method"], row["goals"], row["world"], row["perception"]


def _metrics(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Every known number, named SECTION/SETUP, so that MLflow's chart page has a section for each score."""
    metrics: dict[str, float] = {}
    for row in rows:
        for name, value in row.items():
            if value is None:
                continue
            if name.endswith("_ci95"):
                ends = {f"{name}_low": value[0], f"{name}_high": value[1]}
            elif name.endswith(("_mean", "_std_runs")) or name in COUNTED:
                ends = {name.removesuffix("_mean"): value}
            else:
                continue
            metrics |= {f"{section}/{row['setup']}": float(number) for section, number in ends.items()}
    return metrics


def _tags(run: Path, facts: RunFacts) -> dict[str, str]:
    tags = {
        "evaluation": run.name,
        "folder": str(run.resolve()),
        "origin": facts.origin,
        "data": facts.data_digest,
        "model": facts.model_digest,
        "split_digest": facts.split_digest,
        "cutgrammar": facts.package,
    }
    return tags | ({"commit": facts.commit} if facts.commit else {})


def _table(records: Sequence[Record]) -> str:
    """The trials as comma-separated values."""
    out = io.StringIO()
    scores = list(dict.fromkeys(name for record in records for name in record.scores))
    writer = csv.DictWriter(out, [*TRIAL_COLUMNS, *scores], lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    for record in sorted(records, key=lambda record: record.key):
        writer.writerow({**asdict(record.key), **vars(record), **record.scores})
    return out.getvalue()
