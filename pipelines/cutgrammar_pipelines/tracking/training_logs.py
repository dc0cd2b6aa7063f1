"""A training as a run for MLflow."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from cutgrammar.atomic_files import json_bytes
from cutgrammar.grammar.text import describe
from cutgrammar.storage.shared_storage import absolute
from cutgrammar_pipelines.tracking.run_log import KIND, TRAINING, Input, RunLog, flat

if TYPE_CHECKING:  # torch takes seconds to import, and evaluations do without it
    from cutgrammar.learning.learn import Learned
    from cutgrammar.learning.model import Model

Curve = list[tuple[int, float]]
"""(step, value) pairs."""


PARTS = ("encoder", "classifier", "planes", "bc", "qnet", "goal_planes", "segmentation")
"""The parts of a model that have metrics of their own."""
LEARNED, SEEN = ("features", "induction", "classifier", "planes", "baselines"), ("vision", "cameras", "world")
"""The tables of settings that a training reads, and those that it reads if it learns to segment."""


def training_log(
    path: Path,
    model: "Model",
    learned: "Learned | None",
    data: str | Path,
    files: Sequence[Path] = (),
    history: Mapping[str, Curve] | None = None,
) -> RunLog:
    """A training as one run; numbers that are not finite are left out.

    Args:
        path: folder of the model.
        model: the model in it.
        learned: the history of its training, if that is still known.
        data: folder or URL of the data set it was trained on.
        files: further artifacts, e.g. the picture of its grammar.
        history: the load of the machine (see `system_load`).
    """
    made_from, name = model.provenance, PurePosixPath(data).name
    tables = [*LEARNED, *(SEEN if model.segmentation is not None else ())]
    curves = _loss_curves(learned)
    over_k = _curves_over_k(model)
    pictures = _pictures(path, curves, model)
    gammas = json_bytes(model.induction.get("gammas", [])).decode()
    return RunLog(
        name=path.resolve().name,
        identity={"model": model.digest},
        params={
            "seed": made_from.seed,
            "split": made_from.split,
            "data": f"{name} {made_from.data[:12]}",
            "training_trials": len(made_from.trials),
            **flat({table: asdict(getattr(model.settings, table)) for table in tables}),
        },
        metrics={_metric(name): value for name, value in model.metrics.items() if math.isfinite(value)},
        curves={**curves, **over_k},
        history=dict(history or {}),
        tags={
            KIND: TRAINING,
            "model": model.digest,
            "data": made_from.data,
            "split_digest": made_from.split_digest,
            "cutgrammar": made_from.package,
            "folder": str(path.resolve()),
        },
        inputs=(Input(name, made_from.data, absolute(data), "training"),),
        texts={"grammar.txt": describe(model.grammar), "gammas.json": gammas, **pictures},
        files=tuple(files),
        model=path,
        description="A trained model. `grammar.txt` lists its productions; `model/` is what `evaluate --model` takes.",
    )


def _metric(name: str) -> str:
    """Metrics of one part share a section of the chart page."""
    part = next((part for part in PARTS if name.startswith(f"{part}_")), "induction")
    return f"{part}/{name.removeprefix(f'{part}_')}"


def _loss_curves(learned: "Learned | None") -> dict[str, Curve]:
    """Loss after each epoch, by part: of encoder and segmentation in training, of all but the encoder held out."""
    if learned is None:
        return {}
    losses: dict[str, Sequence[float]] = {
        "loss/encoder": learned.encoder_losses,
        "held_out_loss/classifier": learned.classifier.losses,
        "held_out_loss/planes": learned.planes.losses,
        **{f"held_out_loss/{method}": choice.losses for method, choice in learned.baselines.choices.items()},
        "held_out_loss/goal_planes": learned.baselines.cutting.losses,
    }
    if learned.segmentation:
        losses["loss/segmentation"] = learned.segmentation.losses
        losses["held_out_loss/segmentation"] = learned.segmentation.held_out_losses
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


def _pictures(path: Path, curves: Mapping[str, Curve], model: "Model") -> dict[str, str]:
    """The curves of the training as SVG files."""
    from cutgrammar_dashboards.figures.curves import draw_induction, draw_losses  # matplotlib takes a second to import
    from cutgrammar_dashboards.figures.layout.sheet import sheet_bytes

    name, pictures = path.resolve().name, {}
    if curve := model.induction.get("curve"):
        pictures["induction.svg"] = draw_induction(curve, model.grammar.k, f"Induction of {name}")
    if any(curves.values()):
        pictures["losses.svg"] = draw_losses(curves, f"Losses of {name}")
    return {file: sheet_bytes(figure, "svg").decode() for file, figure in pictures.items()}
