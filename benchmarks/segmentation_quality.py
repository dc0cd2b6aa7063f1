"""Quality of the segmentation of camera views into fragments, and the effect of unobserved undersides (IV-D).

The model must be trained with `cutgrammar train --vision`. All scenes use objects and cuts of the test trials.

- One look: scenes of 2, 4, 8, 16 and 24 fragments (see `cutgrammar_sim.worlds.scenes`), segmented by the network
  alone. The table lists the mean IoU of the visible fragments' points with those of their matched labels (0 without a
  label), the share of fragments with an IoU above 0.75, which count as correctly separated, and the surplus of
  fragments found.
- Trials: demonstrations of test trials repeated on the board and observed after every cut, with and without tracking.
- Undersides: partially observed fragments. The completed mesh is compared with the true one: IoU, distance of z,
  whether the classifier finds the same type, and angle and distance at the centroid of the cutting planes that follow
  for the most probable production of the true type with equal random numbers.

Example:
    python benchmarks/segmentation_quality.py data --model model --scenes 12 --trials 8 --out clouds.png
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Cloud, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import solid_of
from cutgrammar.interfaces import Done, Stuck
from cutgrammar.learning.model import Model, load_model
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.perception.vision.completion import complete
from cutgrammar.perception.vision.convex_parts import hull
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.perception.vision.segment_iou import per_fragment_iou
from cutgrammar.perception.vision.segmentation import Segmentation
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_dashboards.figures.layout.sheet import check_picture_name, write_sheet
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.worlds.board import Board
from cutgrammar_sim.worlds.perceived import GOAL_POINTS, Perceiving
from cutgrammar_sim.worlds.scenes import make_scene
from pictures.segmentation import SegmentedCloud, segmentation_sheet

COUNTS = (2, 4, 8, 16, 24)
BANDS = ((1, 1), (2, 4), (5, 8), (9, 16), (17, 99))
"""Ranges of the number of fragments for the tables of trials."""
SEPARATED = 0.75
"""A fragment whose IoU is above this counts as correctly separated."""
MIN_POINTS = 60
"""Minimum number of points of a fragment whose completion is evaluated."""
MAX_COMPLETIONS = 160
"""Maximum number of completions that are evaluated."""
SHOWN = (4, 8, 16)
"""Numbers of fragments of the scenes in the picture."""

Complete = Callable[[Floats, Floats], Mesh | Cloud | None]
COMPLETIONS: dict[str, Complete] = {
    "points as seen": lambda points, normals: Cloud(points, normals),
    "their convex hull": lambda points, _: hull(points),
    "down to the board": partial(complete, mirrored=0.0),
    "halfway (used)": complete,
    "mirrored": partial(complete, mirrored=1.0),
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene and its fused cloud.

    Attributes:
        meshes: the fragments in W.
        sight: the cloud with its true fragments.
    """

    meshes: tuple[Mesh, ...]
    sight: LabelledCloud


def scenes_of(demonstrations: Sequence[Demonstration], count: int, number: int, seed: int) -> list[Scene]:
    """`number` scenes of `count` fragments."""
    settings, made = Settings(), []
    for i in range(number):
        rng = stream(seed, "segmentation quality", count, i)
        now = make_scene(demonstrations, settings, rng, count)
        made.append(Scene(tuple(f.mesh.moved(f.X_WF) for f in now), look(now, settings.cameras, rng)))
    return made


def one_look(scenes: Sequence[Scene], segmentation: Segmentation) -> dict[str, Any]:
    """Evaluate the network alone."""
    ious, too_many = [], []
    for scene in scenes:
        labels = segmentation(scene.sight.points, scene.sight.normals)
        ious.append(per_fragment_iou(scene.sight.owners, labels))
        too_many.append(int(labels.max()) + 1 - len(ious[-1]))
    each = np.concatenate(ious)
    return {
        "scenes": len(scenes),
        "fragments": len(each),
        "out_of_sight": sum(len(scene.meshes) for scene in scenes) - len(each),
        "iou": float(each.mean()),
        "separated": float(np.mean(each > SEPARATED)),
        "too_many": float(np.mean(too_many)),
        "off_by": float(np.mean(np.abs(too_many))),
    }


def repeated(
    demonstration: Demonstration, segmentation: Segmentation, belief: bool, seed: int
) -> list[dict[str, float]]:
    """Repeat a demonstration on the board; return one row per look."""
    settings = replace(Settings(), vision=replace(Settings().vision, belief=belief))
    streams = partial(stream, seed, "segmentation quality", "trial", demonstration.trial)
    world = Perceiving(Board(settings.world), segmentation, settings, streams)
    world.reset(demonstration.start)
    planner, rows = ReplayPlanner(demonstration), list[dict[str, float]]()
    while True:
        now, truth = world.observe(), world.truth()
        seen = world.sighted(len(rows) + 1)
        iou = per_fragment_iou(seen.owners, seen.labels)
        separated = float(np.mean(iou > SEPARATED))
        row = {"there": len(truth), "too_many": len(now) - len(truth), "iou": iou.mean(), "separated": separated}
        rows.append(row)
        if len(truth) >= len(demonstration.goal):
            return rows
        cut = planner.next_cut(truth, (), (), stream(seed, "replay", len(rows)))
        if isinstance(cut, Stuck) or not isinstance(world.apply(cut), Done):
            return rows


def banded(rows: Sequence[dict[str, float]]) -> list[dict[str, Any]]:
    """Means over the looks, by range of the number of fragments."""
    table = []
    for low, high in BANDS:
        some = [row for row in rows if low <= row["there"] <= high]
        if some:
            means = {name: float(np.mean([row[name] for row in some])) for name in ("iou", "separated", "too_many")}
            off = float(np.mean([abs(row["too_many"]) for row in some]))
            table.append(
                {"fragments": f"{low}" if low == high else f"{low} to {high}", "looks": len(some)}
                | means
                | {"off_by": off}
            )
    return table


def undersides(scenes: Sequence[Scene], model: Model, seed: int) -> dict[str, Any]:
    """Effect of the completion of partially observed fragments on shape, z, type and plane."""
    rows: dict[str, list[list[float]]] = {name: [] for name in (*COMPLETIONS, "whole cloud", "hull of it")}
    features = []
    owned = [(scene, i, scene.sight.owners == i) for scene in scenes for i in range(len(scene.meshes))]
    seen = [(scene, i, own) for scene, i, own in owned if own.sum() >= MIN_POINTS]
    for number in np.linspace(0, len(seen) - 1, min(MAX_COMPLETIONS, len(seen))).astype(int):
        scene, i, own = seen[number]
        mesh, whole = scene.meshes[i], sample_surface(scene.meshes[i], GOAL_POINTS)
        features.append(model.features(mesh))
        rng = partial(stream, seed, "plane", len(features))
        shapes = {name: make(scene.sight.points[own], scene.sight.normals[own]) for name, make in COMPLETIONS.items()}
        for name, shape in {**shapes, "whole cloud": whole, "hull of it": hull(whole.points)}.items():
            if shape is not None:
                rows[name].append(_compared(mesh, features[-1], shape, model, rng))
    z = np.array(features)
    apart = np.linalg.norm(z[:, None] - z, axis=2)
    np.fill_diagonal(apart, np.inf)
    names = ("iou", "volume", "z", "same_type", "angle_deg", "offset_mm")
    return {
        "fragments": len(z),
        "apart": float(np.median(apart[np.isfinite(apart)])),
        "nearest": float(np.median(apart.min(axis=1))),
        "completions": {
            name: {"fragments": len(some)} | dict(zip(names, _summary(np.array(some)), strict=True))
            for name, some in rows.items()
        },
    }


def _compared(
    mesh: Mesh, true_z: Floats, shape: Mesh | Cloud, model: Model, rng: Callable[[], np.random.Generator]
) -> list[float]:
    """IoU, ratio of volumes, distance of z, same type, angle and offset of the plane (NaN if undefined)."""
    iou = np.nan
    if isinstance(shape, Mesh):
        a, b = solid_of(mesh), solid_of(shape)
        both = (a ^ b).volume()
        iou = both / (a.volume() + b.volume() - both)
    z = model.features(shape)
    kind, true_kind = (int(np.argmax(model.classifier.log_probabilities(feature)[0])) for feature in (z, true_z))
    angle, offset = np.nan, np.nan
    options = model.grammar.options.get(true_kind)
    if options:
        production = max(options, key=lambda option: model.grammar.probabilities[option])
        planes: list[Plane] = [
            model.planes.sample(production, feature, rng(), 64).transformed(canonical_frame(described))
            for feature, described in ((true_z, mesh), (z, shape))
        ]
        angle = float(np.degrees(np.arccos(min(1.0, abs(planes[0].normal @ planes[1].normal)))))
        foot = mesh.centroid - planes[0].distances(mesh.centroid[None])[0] * planes[0].normal
        offset = 1e3 * abs(float(planes[1].distances(foot[None])[0]))
    same = float(kind == true_kind)
    return [iou, shape.volume / mesh.volume, float(np.linalg.norm(z - true_z)), same, angle, offset]


def _summary(rows: Floats) -> list[float]:
    """Means of the IoU and of the same type; medians of the other columns."""
    known = [column[np.isfinite(column)] for column in rows.T]
    how = (np.mean, np.median, np.median, np.mean, np.median, np.median)
    return [
        float(function(column)) if len(column) else float("nan") for function, column in zip(how, known, strict=True)
    ]


def picture(scenes: dict[int, list[Scene]], segmentation: Segmentation) -> list[SegmentedCloud]:
    """The first scene of each number of fragments in the picture."""
    clouds = []
    for count in SHOWN:
        sight = scenes[count][0].sight
        labels = segmentation(sight.points, sight.normals)
        iou = per_fragment_iou(sight.owners, labels)
        note = f"{count} fragments, {len(iou)} in sight; {int(labels.max()) + 1} found, mean IoU {iou.mean():.2f}"
        clouds.append(SegmentedCloud(sight.points, sight.owners, labels, note))
    return clouds


def tables(numbers: dict[str, Any]) -> str:
    """Format the numbers as tables."""
    lines = [
        "One look, the network alone",
        f"{'fragments':>10}{'in sight':>10}{'mean IoU':>10}{'separated':>11}{'too many':>10}{'off by':>8}",
    ]
    for count, row in numbers["one_look"].items():
        lines.append(
            f"{count:>10}{row['fragments']:10d}{row['iou']:10.3f}{row['separated']:11.3f}"
            f"{row['too_many']:+10.2f}{row['off_by']:8.2f}"
        )
    for name, rows in numbers["trials"].items():
        lines += [
            "",
            name,
            f"{'fragments':>10}{'looks':>10}{'mean IoU':>10}{'separated':>11}{'too many':>10}{'off by':>8}",
        ]
        lines += [
            f"{row['fragments']:>10}{row['looks']:10d}{row['iou']:10.3f}{row['separated']:11.3f}"
            f"{row['too_many']:+10.2f}{row['off_by']:8.2f}"
            for row in rows
        ]
    under = numbers["undersides"]
    lines += [
        "",
        f"Completed fragments: {under['fragments']}; median distance in z to other fragments {under['apart']:.2f}, "
        f"to the nearest {under['nearest']:.2f}",
        f"{'':20}{'IoU':>7}{'volume':>9}{'z':>7}{'same type':>11}{'plane, deg':>12}{'plane, mm':>11}",
    ]
    for name, row in under["completions"].items():
        iou = f"{row['iou']:7.3f}" if np.isfinite(row["iou"]) else f"{'-':>7}"
        lines.append(
            f"{name:20}{iou}{row['volume']:9.2f}{row['z']:7.2f}{row['same_type']:11.2f}"
            f"{row['angle_deg']:12.1f}{row['offset_mm']:11.1f}"
        )
    return "\n".join(lines)


def measured(data: Path, model: Path, number: int, trials: int, seed: int, out: Path | None) -> dict[str, Any]:
    """Measure everything.

    Raises:
        InputError: the data set, model or picture file cannot be used.
    """
    if out is not None:
        check_picture_name(out)
    source, learned = DataSet.open(data), load_model(model)
    if learned.segmentation is None:
        raise InputError(f"{model} has no segmentation; train with cutgrammar train --vision")
    tests = read_split(source, learned.provenance.split).test
    demonstrations = [source.demonstration(trial) for trial in tests]
    scenes: dict[int, list[Scene]] = {}
    one: dict[str, Any] = {}
    with progress("one look", len(COUNTS)) as advance:
        for count in COUNTS:
            scenes[count] = scenes_of(demonstrations, count, number, seed)
            one[str(count)] = one_look(scenes[count], learned.segmentation)
            advance()
    chosen = [demonstrations[i] for i in np.linspace(0, len(demonstrations) - 1, trials).astype(int)]
    repeats: dict[str, Any] = {}
    with progress("trials", 2 * len(chosen)) as advance:
        for name, belief in (("Trials, with belief", True), ("Trials, without", False)):
            rows = []
            for demonstration in chosen:
                rows += repeated(demonstration, learned.segmentation, belief, seed)
                advance()
            repeats[name] = banded(rows)
    if out is not None:
        title = "True fragments (left), and the fragments that the network alone finds in one look (right)"
        write_sheet(segmentation_sheet(picture(scenes, learned.segmentation), title), out)
    every = [scene for count in COUNTS for scene in scenes[count]]
    return {"one_look": one, "trials": repeats, "undersides": undersides(every, learned, seed)}


def main() -> int:
    """Measure and print; the exit code is 2 for invalid input."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, metavar="DATA", help="a data set with a split")
    parser.add_argument("--model", type=Path, required=True, metavar="MODEL", help="a model trained with --vision")
    parser.add_argument("--scenes", type=int, default=12, help="scenes for each number of fragments (default 12)")
    parser.add_argument("--trials", type=int, default=8, help="number of repeated demonstrations (default 8)")
    parser.add_argument("--seed", type=int, default=100, help="seed of scenes and noise (default 100)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="picture of some scenes, .png or .svg")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    chosen = parser.parse_args()
    try:
        numbers = measured(chosen.data, chosen.model, chosen.scenes, chosen.trials, chosen.seed, chosen.out)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(numbers) if chosen.json else tables(numbers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
