"""A training as runs for MLflow."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutgrammar.atomic_files import json_bytes
from cutgrammar.grammar.text import describe
from cutgrammar_pipelines.tracking.run_log import Input, RunLog

if TYPE_CHECKING:  # torch takes seconds to import, and evaluations do without it
    from cutgrammar.learning.learn import Learned
    from cutgrammar.learning.model import Model

Curve = list[tuple[int, float]]
"""(step, value) pairs."""


def training_logs(path: Path, model: "Model", learned: "Learned | None", data: Path) -> list[RunLog]:
    """One run for each part of a training; numbers that are not finite are left out.

    Args:
        path: folder of the model.
        model: the model in it.
        learned: the history of its training, if that is still known.
        data: folder of the data set it was trained on.
    """
    made_from, settings = model.provenance, model.settings
    common = {
        "model": model.digest,
        "data": made_from.data,
        "split_digest": made_from.split_digest,
        "cutgrammar": made_from.package,
        "folder": str(path.resolve()),
    }
    curves = _loss_curves(learned)
    parts: dict[str, tuple[Any, Mapping[str, Curve]]] = {
        "encoder": (settings.features, {"loss": curves.get("encoder", [])}),
        "induction": (settings.induction, _curves_over_k(model)),
    }
    for name, own in (("classifier", settings.classifier), ("planes", settings.planes)):
        parts[name] = own, {"held_out_loss": curves.get(name, [])}
    for name in ("bc", "qnet", "goal_planes"):
        parts[name] = settings.baselines, {"held_out_loss": curves.get(name, [])}
    if model.segmentation is not None:
        held_out = {"held_out_loss": curve} if (curve := curves.get("segmentation_held_out")) else {}
        parts["segmentation"] = settings.vision, {"loss": curves.get("segmentation", []), **held_out}
    logs = []
    for name, (own, shown) in parts.items():
        title = f"{name} of {path.name}"
        file, metrics = f"{name}.safetensors", [metric for metric in model.metrics if metric.startswith(f"{name}_")]
        texts = _curve_picture(title, shown, model)
        if name == "induction":
            file, metrics = "grammar.json", ["fragments", "cuts", "k", "gamma", "productions"]
            gammas = json_bytes(model.induction.get("gammas", [])).decode()
            texts = {"grammar.txt": describe(model.grammar), "gammas.json": gammas, **texts}
        logs.append(
            RunLog(
                name=title,
                identity={"model": model.digest, "part": name},
                params={"seed": made_from.seed, "split": made_from.split, **asdict(own)},
                metrics={metric: model.metrics[metric] for metric in metrics if metric in model.metrics},
                curves=shown,
                tags={"part": name, **common},
                inputs=(Input(data.name, made_from.data, str(data.resolve()), "training"),),
                texts=texts,
                files=(path / file,),
            )
        )
    return logs


def _loss_curves(learned: "Learned | None") -> dict[str, Curve]:
    """Loss after each epoch, by part: of the encoder in training, of all others held out."""
    if learned is None:
        return {}
    losses: dict[str, Sequence[float]] = {
        "encoder": learned.encoder_losses,
        "classifier": learned.classifier.losses,
        "planes": learned.planes.losses,
        **{method: choice.losses for method, choice in learned.baselines.choices.items()},
        "goal_planes": learned.baselines.cutting.losses,
    }
    if learned.segmentation:
        losses["segmentation"] = learned.segmentation.losses
        losses["segmentation_held_out"] = learned.segmentation.held_out_losses
    return {
        name: [(epoch, loss) for epoch, loss in enumerate(values, start=1) if math.isfinite(loss)]
        for name, values in losses.items()
    }


def _curves_over_k(model: "Model") -> dict[str, Curve]:
    """The numbers of induction for each number of types k."""
    curves: dict[str, Curve] = {}
    for point in model.induction.get("curve", ()):
        for name, value in point.items():
            if name != "k" and value is not None:
                curves.setdefault(f"over_k/{name}", []).append((point["k"], value))
    return curves


def _curve_picture(title: str, curves: Mapping[str, Curve], model: "Model") -> dict[str, str]:
    """The curves of a part as an SVG file; nothing if there are none."""
    from cutgrammar_dashboards.figures.curves import draw_induction, draw_losses  # matplotlib takes a second to import
    from cutgrammar_dashboards.figures.layout.sheet import sheet_bytes

    if any(name.startswith("over_k/") for name in curves):
        figure = draw_induction(model.induction["curve"], model.grammar.k, title)
    elif any(curves.values()):
        figure = draw_losses(curves, title)
    else:
        return {}
    return {"curves.svg": sheet_bytes(figure, "svg").decode()}
