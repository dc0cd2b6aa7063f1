"""How much of a fragment's shape z holds, and how little z changes when it should not (III-D).

    python benchmarks/encoder_quality.py DATA [--model MODEL] [--out fragments.png] [--json]

The encoder is trained on the training trials of DATA's split, as `cutgrammar train` does it: with a model its settings
and seed are used, and it must come out with the same bits. That gives its decoder, which a model does not keep.

Measured are the IoU of fragments and their reconstructions (training trials, other trials of the same foods, foods that
the encoder never saw) beside what the mean shape and the nearest training fragment would give; and how far z moves
under rigid motion, other triangles and other surface points, beside how far fragments lie apart.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar.demonstration import CATEGORIES, Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.learning.encoder_training import fit_features
from cutgrammar.learning.learn import training_fragments
from cutgrammar.learning.model import load_model
from cutgrammar.perception.classifier import TypeClassifier
from cutgrammar.perception.encoder import Decoder
from cutgrammar.perception.feature import FeatureExtractor, normalised
from cutgrammar.perception.occupancy import inside
from cutgrammar.seeds import stream
from cutgrammar.settings import FeatureSettings, Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import Split, read_split
from cutgrammar.trials.setups import SETUPS
from cutgrammar_dashboards.figures.layout.sheet import check_picture_name, write_sheet
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_sim import foods
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from measures.reconstruction import overlap_with, reconstructed, reconstruction
from measures.stability import CHANGES, shifts
from pictures.reconstruction import Pair, reconstruction_sheet

NEVER_SEEN = {"apple": foods.apple, "aubergine": foods.aubergine, "banana": foods.banana}
ROUNDS = 3
"""Demonstrations of every category for each food never seen."""
SHOWN = (0.9, 0.7, 0.5, 0.3, 0.1)
"""Which fragments of each group are drawn: those at these quantiles of the IoU."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A fragment and what became of it.

    Attributes:
        mesh: in a frame of its own.
        iou: with its reconstruction.
        mean_shape: with what the decoder makes of the mean z_shape.
        nearest: with the training fragment (another one) whose z_shape is nearest.
    """

    mesh: Mesh
    iou: float
    mean_shape: float
    nearest: float


@dataclass(frozen=True, eq=False)
class Trained:
    """The encoder with its decoder and what it was trained on.

    Attributes:
        features: fragment -> z.
        decoder: (z_shape, point) -> inside.
        meshes: the training fragments, each in its canonical frame, divided by its scale.
        z: (n, 17) their features.
        loss: mean binary cross entropy of the last epoch [nats].
    """

    features: FeatureExtractor
    decoder: Decoder
    meshes: tuple[Mesh, ...]
    z: Floats
    loss: float


def trained_on(demonstrations: Sequence[Demonstration], settings: FeatureSettings, seed: int) -> Trained:
    """The encoder as `learn` trains it."""
    meshes = training_fragments(demonstrations).meshes
    with progress("encoder", settings.epochs) as advance:
        features, training = fit_features(meshes, settings, stream(seed, "encoder"), lambda *_: advance())
    z = np.array([features(mesh) for mesh in meshes])
    return Trained(features, training.decoder, tuple(_unit(mesh) for mesh in meshes), z, training.losses[-1])


def reconstruct(trained: Trained, mesh: Mesh) -> Seen:
    """A fragment beside its reconstruction."""
    z_shape, unit = trained.features(mesh)[:-1], _unit(mesh)
    distances = np.linalg.norm(trained.z[:, :-1] - z_shape, axis=1)
    other = trained.meshes[int(np.argmin(np.where(distances > 0.0, distances, np.inf)))]
    regions = (
        reconstruction(trained.decoder, z_shape),
        reconstruction(trained.decoder, np.zeros_like(z_shape)),
        partial(inside, other),
    )
    return Seen(mesh, *(overlap_with(unit, region) for region in regions))


def never_seen(food: str, seed: int) -> list[Demonstration]:
    """Demonstrations of a food that is in no data set unless it is asked for."""
    jobs = [category for _ in range(ROUNDS) for category in CATEGORIES]
    cut = partial(make_demonstration, foods={food: NEVER_SEEN[food]}, seed=seed, settings=Settings().demonstrator)
    return [cut(trial, SETUPS["N1M1"], (category,)) for trial, category in enumerate(jobs)]


def stability(
    trained: Trained, meshes: Sequence[Mesh], types: TypeClassifier | None, seed: int
) -> dict[str, dict[str, float]]:
    """For every change that should change nothing: how far z moves, and with a classifier how often its type stays."""
    rows = {}
    for name, change in CHANGES.items():
        found = shifts(trained.features, meshes, change, stream(seed, "encoder quality", name))
        rows[name] = {
            "median": float(np.median(found.shape)),
            "p95": float(np.quantile(found.shape, 0.95)),
            "best_flip_p95": float(np.quantile(found.shape_best_flip, 0.95)),
            "scale_p95": float(np.quantile(found.scale, 0.95)),
        }
        if types is not None:
            before, after = (types.log_probabilities(z).argmax(axis=1) for z in (found.before, found.after))
            rows[name]["same_type"] = float(np.mean(before == after))
    return rows


def apart(z: Floats) -> dict[str, float]:
    """How far fragments lie apart: median distance of z_shape to the nearest other fragment, and to any other."""
    distances = np.linalg.norm(z[:, None, :-1] - z[None, :, :-1], axis=2)
    np.fill_diagonal(distances, np.inf)
    return {
        "nearest": float(np.median(distances.min(axis=1))),
        "any": float(np.median(distances[np.isfinite(distances)])),
    }


def summary(seen: Sequence[Seen]) -> dict[str, float]:
    """Number, mean, median and low tenth of the IoU, and the means of what it stands beside."""
    ious = np.array([one.iou for one in seen])
    return {
        "fragments": len(seen),
        "iou_mean": float(ious.mean()),
        "iou_median": float(np.median(ious)),
        "iou_p10": float(np.quantile(ious, 0.1)),
        "mean_shape": float(np.mean([one.mean_shape for one in seen])),
        "nearest": float(np.mean([one.nearest for one in seen])),
    }


def pairs(trained: Trained, seen: Sequence[Seen]) -> list[Pair]:
    """The fragments at the quantiles `SHOWN` of the IoU, with their reconstructions."""
    ordered = sorted(seen, key=lambda one: one.iou)
    shown = []
    for share in SHOWN:
        one = ordered[round(share * (len(ordered) - 1))]
        made = reconstructed(trained.decoder, trained.features(one.mesh)[:-1])
        shown.append(Pair(_unit(one.mesh), made, one.iou))
    return shown


def _unit(mesh: Mesh) -> Mesh:
    unit = normalised(mesh, 32).mesh
    assert unit is not None
    return unit


def main() -> int:
    """Train, measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="data set with a split")
    parser.add_argument("--model", type=Path, help="trained on it; its settings, seed and split are taken")
    parser.add_argument("--split", default="paper", help="without a model: whose training trials are used")
    parser.add_argument("--seed", type=int, default=0, help="without a model: of the training")
    parser.add_argument("--fragments", type=int, default=100, help="at most so many of each group")
    parser.add_argument("--out", type=Path, help="a PNG or SVG of fragments beside their reconstructions")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    options = parser.parse_args()
    try:
        if options.out is not None:
            check_picture_name(options.out)
        report(options)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def report(options: argparse.Namespace) -> None:
    """Measure what the options ask for, print it, draw it.

    Raises:
        InputError: no such data set, split or model, or the model is of another data set or made elsewhere.
    """
    data, model = DataSet.open(options.data), load_model(options.model) if options.model else None
    split = read_split(data, model.provenance.split if model else options.split)
    settings, seed = (model.settings.features, model.provenance.seed) if model else (FeatureSettings(), options.seed)
    if model and (model.provenance.data, model.provenance.split_digest) != (data.digest, split.digest):
        raise InputError(f"{options.model} was not trained on {options.data}; give the data set that it was trained on")
    training = [data.demonstration(trial) for trial in split.train]
    trained = trained_on(training, settings, seed)
    if model and trained.features.to_bytes() != model.features.to_bytes():
        raise InputError(f"the encoder of {options.model} comes out with other bits here; train the model again")
    groups = compared(trained, sources(data, split, training, seed), options.fragments, seed)
    held_out = [one.mesh for one in groups["held-out trials"]]
    numbers = {
        "encoder_loss": trained.loss,
        "reconstruction": {name: summary(seen) for name, seen in groups.items()},
        "apart": apart(np.array([trained.features(mesh) for mesh in held_out])),
        "stability": stability(trained, held_out, model.classifier if model else None, seed),
    }
    print(json.dumps(numbers) if options.json else told(numbers))
    if options.out is not None:
        title = "Fragments and what the decoder makes of their shape features, from the best to the worst tenth"
        write_sheet(
            reconstruction_sheet({name: pairs(trained, seen) for name, seen in groups.items()}, title), options.out
        )


def sources(
    data: DataSet, split: Split, training: Sequence[Demonstration], seed: int
) -> dict[str, Sequence[Demonstration]]:
    """The demonstrations of every group by its name."""
    known = {food for demonstration in training for food in demonstration.foods}
    tests = [data.demonstration(trial) for trial in split.test]
    held_out = [demonstration for demonstration in tests if set(demonstration.foods) <= known]
    if not held_out:
        raise InputError(f"no test trial of {data.path} holds only foods that were trained on; collect more trials")
    others = {food: never_seen(food, seed) for food in NEVER_SEEN if food not in known}
    return {"training trials": training, "held-out trials": held_out, **others}


def compared(
    trained: Trained, groups: Mapping[str, Sequence[Demonstration]], most: int, seed: int
) -> dict[str, list[Seen]]:
    """At most `most` fragments of each group, drawn at random, each beside its reconstruction."""
    chosen: dict[str, list[Mesh]] = {}
    for name, demonstrations in groups.items():
        there = training_fragments(demonstrations).meshes
        order = stream(seed, "encoder quality", name).permutation(len(there))
        chosen[name] = [there[i] for i in np.sort(order[:most])]
    seen: dict[str, list[Seen]] = {name: [] for name in chosen}
    with progress("reconstruct", sum(len(meshes) for meshes in chosen.values())) as advance:
        for name, meshes in chosen.items():
            for mesh in meshes:
                seen[name].append(reconstruct(trained, mesh))
                advance()
    return seen


def told(numbers: Mapping[str, Any]) -> str:
    """The numbers as tables."""
    lines = [
        f"encoder: cross entropy {numbers['encoder_loss']:.3f} at the end of training",
        "",
        "IoU of fragments with their reconstructions; beside it the means for the mean shape and the nearest training",
        "fragment in their place",
        f"{'':18}{'fragments':>10}{'mean':>8}{'median':>8}{'low 10 %':>10}{'mean shape':>12}{'nearest':>9}",
    ]
    for name, row in numbers["reconstruction"].items():
        lines.append(
            f"{name:18}{row['fragments']:10d}{row['iou_mean']:8.3f}{row['iou_median']:8.3f}{row['iou_p10']:10.3f}"
            f"{row['mean_shape']:12.3f}{row['nearest']:9.3f}"
        )
    lines += [
        "",
        "How far z_shape moves (held-out fragments; in the median another fragment is "
        f"{numbers['apart']['any']:.2f} away, the nearest {numbers['apart']['nearest']:.2f})",
        f"{'':18}{'median':>10}{'95 %':>10}{'95 %, best flip':>17}{'95 %, z_scale':>15}{'same type':>11}",
    ]
    for name, row in numbers["stability"].items():
        same = f"{row['same_type']:11.2f}" if "same_type" in row else f"{'-':>11}"
        lines.append(
            f"{name:18}{row['median']:10.2g}{row['p95']:10.2g}{row['best_flip_p95']:17.2g}{row['scale_p95']:15.2g}{same}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
