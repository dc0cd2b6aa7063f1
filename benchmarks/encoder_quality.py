"""Quality of the shape feature z: how well it describes shapes, and how stable it is (III-D).

The encoder is trained on the training trials of the data set's split as in `cutgrammar train`. With a model, its
settings and seed are used, and the result must be identical to its encoder; training again provides the decoder, which
a model does not contain.

The first table lists the IoU of fragments with their reconstructions, for training trials, other trials of the same
foods and foods that the encoder has not seen; the mean shape and the nearest training fragment serve as baselines. The
second table lists how far z moves under rigid motion and with other triangles and surface points, compared with the
distances between fragments.

Example:
    python benchmarks/encoder_quality.py data --model model --out fragments.png
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
from cutgrammar.learning.model import load_model
from cutgrammar.learning.training_fragments import training_fragments
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

UNSEEN_FOODS = {"apple": foods.apple, "aubergine": foods.aubergine, "banana": foods.banana}
ROUNDS = 3
"""Number of demonstrations per category for each unseen food."""
SHOWN = (0.9, 0.7, 0.5, 0.3, 0.1)
"""Quantiles of the IoU of the fragments that are drawn for each group."""


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """A fragment and the quality of its reconstruction.

    Attributes:
        mesh: the fragment in its frame F.
        iou: IoU with its reconstruction.
        mean_shape: IoU with the reconstruction of the mean z_shape.
        nearest: IoU with the other training fragment whose z_shape is nearest.
    """

    mesh: Mesh
    iou: float
    mean_shape: float
    nearest: float


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained encoder with its decoder and training set.

    Attributes:
        features: fragment -> z.
        decoder: (z_shape, point) -> probability that the point is inside.
        meshes: the training fragments in their canonical frames, divided by their scales.
        z: (n, 17) their features.
        loss: mean binary cross entropy of the last epoch [nats].
    """

    features: FeatureExtractor
    decoder: Decoder
    meshes: tuple[Mesh, ...]
    z: Floats
    loss: float


def trained_on(demonstrations: Sequence[Demonstration], settings: FeatureSettings, seed: int) -> Trained:
    """Train the encoder as in `learn`."""
    meshes = training_fragments(demonstrations).meshes
    with progress("encoder", settings.epochs) as advance:
        features, training = fit_features(meshes, settings, stream(seed, "encoder"), lambda *_: advance())
    z = np.array([features(mesh) for mesh in meshes])
    return Trained(features, training.decoder, tuple(_unit(mesh) for mesh in meshes), z, training.losses[-1])


def reconstruct(trained: Trained, mesh: Mesh) -> Reconstructed:
    """Compare a fragment with its reconstruction."""
    z_shape, unit = trained.features(mesh)[:-1], _unit(mesh)
    distances = np.linalg.norm(trained.z[:, :-1] - z_shape, axis=1)
    other = trained.meshes[int(np.argmin(np.where(distances > 0.0, distances, np.inf)))]
    regions = (
        reconstruction(trained.decoder, z_shape),
        reconstruction(trained.decoder, np.zeros_like(z_shape)),
        partial(inside, other),
    )
    return Reconstructed(mesh, *(overlap_with(unit, region) for region in regions))


def demonstrate_unseen(food: str, seed: int) -> list[Demonstration]:
    """Demonstrations of a food that data sets contain only on request."""
    jobs = [category for _ in range(ROUNDS) for category in CATEGORIES]
    cut = partial(make_demonstration, foods={food: UNSEEN_FOODS[food]}, seed=seed, settings=Settings().demonstrator)
    return [cut(trial, SETUPS["N1M1"], (category,)) for trial, category in enumerate(jobs)]


def stability(
    trained: Trained, meshes: Sequence[Mesh], types: TypeClassifier | None, seed: int
) -> dict[str, dict[str, float]]:
    """For every change of representation: how far z moves and, with a classifier, how often the type stays the same."""
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


def distances_apart(z: Floats) -> dict[str, float]:
    """Median distance of z_shape to the nearest other fragment, and to any other fragment."""
    distances = np.linalg.norm(z[:, None, :-1] - z[None, :, :-1], axis=2)
    np.fill_diagonal(distances, np.inf)
    return {
        "nearest": float(np.median(distances.min(axis=1))),
        "any": float(np.median(distances[np.isfinite(distances)])),
    }


def summary(seen: Sequence[Reconstructed]) -> dict[str, float]:
    """Number of fragments; mean, median and 10 % quantile of the IoU; means of the baselines."""
    ious = np.array([item.iou for item in seen])
    return {
        "fragments": len(seen),
        "iou_mean": float(ious.mean()),
        "iou_median": float(np.median(ious)),
        "iou_p10": float(np.quantile(ious, 0.1)),
        "mean_shape": float(np.mean([item.mean_shape for item in seen])),
        "nearest": float(np.mean([item.nearest for item in seen])),
    }


def pairs(trained: Trained, seen: Sequence[Reconstructed]) -> list[Pair]:
    """The fragments at the quantiles `SHOWN` of the IoU, with their reconstructions."""
    ordered = sorted(seen, key=lambda item: item.iou)
    shown = []
    for share in SHOWN:
        item = ordered[round(share * (len(ordered) - 1))]
        made = reconstructed(trained.decoder, trained.features(item.mesh)[:-1])
        shown.append(Pair(_unit(item.mesh), made, item.iou))
    return shown


def _unit(mesh: Mesh) -> Mesh:
    unit = normalised(mesh, 32).mesh
    assert unit is not None
    return unit


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="a data set with a split")
    parser.add_argument("--model", type=Path, help="a model trained on it, whose settings, seed and split are used")
    parser.add_argument("--split", default="paper", help="without a model: name of the split")
    parser.add_argument("--seed", type=int, default=0, help="without a model: seed of the training")
    parser.add_argument("--fragments", type=int, default=100, help="maximum number of fragments of each group")
    parser.add_argument("--out", type=Path, help="a PNG or SVG file for pictures of fragments and reconstructions")
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
    """Train, measure, print and draw.

    Raises:
        InputError: data set, split or model cannot be used, or training does not reproduce the model.
    """
    data, model = DataSet.open(options.data), load_model(options.model) if options.model else None
    split = read_split(data, model.provenance.split if model else options.split)
    settings, seed = (model.settings.features, model.provenance.seed) if model else (FeatureSettings(), options.seed)
    if model and (model.provenance.data, model.provenance.split_digest) != (data.digest, split.digest):
        raise InputError(f"{options.model} was not trained on {options.data}; give the data set that it was trained on")
    training = [data.demonstration(trial) for trial in split.train]
    trained = trained_on(training, settings, seed)
    if model and trained.features.to_bytes() != model.features.to_bytes():
        raise InputError(f"training does not reproduce the encoder of {options.model}; train the model again")
    groups = compared(trained, sources(data, split, training, seed), options.fragments, seed)
    held_out = [item.mesh for item in groups["held-out trials"]]
    numbers = {
        "encoder_loss": trained.loss,
        "reconstruction": {name: summary(seen) for name, seen in groups.items()},
        "apart": distances_apart(np.array([trained.features(mesh) for mesh in held_out])),
        "stability": stability(trained, held_out, model.classifier if model else None, seed),
    }
    print(json.dumps(numbers) if options.json else tables(numbers))
    if options.out is not None:
        title = "Fragments and their reconstructions from shape features, from the best to the worst tenth"
        write_sheet(
            reconstruction_sheet({name: pairs(trained, seen) for name, seen in groups.items()}, title), options.out
        )


def sources(
    data: DataSet, split: Split, training: Sequence[Demonstration], seed: int
) -> dict[str, Sequence[Demonstration]]:
    """The demonstrations of every group, by name."""
    known = {food for demonstration in training for food in demonstration.foods}
    tests = [data.demonstration(trial) for trial in split.test]
    held_out = [demonstration for demonstration in tests if set(demonstration.foods) <= known]
    if not held_out:
        raise InputError(f"no test trial of {data.path} has only foods of the training trials; collect more trials")
    others = {food: demonstrate_unseen(food, seed) for food in UNSEEN_FOODS if food not in known}
    return {"training trials": training, "held-out trials": held_out, **others}


def compared(
    trained: Trained, groups: Mapping[str, Sequence[Demonstration]], max_fragments: int, seed: int
) -> dict[str, list[Reconstructed]]:
    """At most `max_fragments` random fragments of each group, compared with their reconstructions."""
    chosen: dict[str, list[Mesh]] = {}
    for name, demonstrations in groups.items():
        meshes_of_group = training_fragments(demonstrations).meshes
        order = stream(seed, "encoder quality", name).permutation(len(meshes_of_group))
        chosen[name] = [meshes_of_group[i] for i in np.sort(order[:max_fragments])]
    seen: dict[str, list[Reconstructed]] = {name: [] for name in chosen}
    with progress("reconstruct", sum(len(meshes) for meshes in chosen.values())) as advance:
        for name, meshes in chosen.items():
            for mesh in meshes:
                seen[name].append(reconstruct(trained, mesh))
                advance()
    return seen


def tables(numbers: Mapping[str, Any]) -> str:
    """Format the numbers as tables."""
    lines = [
        f"encoder: cross entropy {numbers['encoder_loss']:.3f} at the end of training",
        "",
        "IoU of fragments with their reconstructions; mean IoU with the mean shape and the nearest training fragment",
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
