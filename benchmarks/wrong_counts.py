"""In how many looks of two cameras the number of perceived fragments is wrong, and why (IV-D).

Demonstrations of the test trials are repeated with the demonstrated cuts, with a look after every cut. Each look is
divided into classes by the true fragments, which no planner sees; a look can belong to several.

- hidden: a fragment has fewer than 20 points in the cloud.
- joined: most points of a fragment belong to a perceived one that has more points of another.
- left out: most points of a fragment belong to no perceived one.
- split: a fragment has most of the points of two perceived ones.
- remembered: a perceived fragment has no points; the robot keeps it where it was predicted.

Example:
    python benchmarks/wrong_counts.py data --model model --trials 8 --seed 4
"""

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Ints
from cutgrammar.interfaces import Done, Stuck
from cutgrammar.learning.model import Model, load_model
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.plugins import WORLDS, load, reference_of
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_sim.worlds.perceived import make_perceiving

MIN_POINTS = 20
"""A fragment with fewer points is hidden."""
CLASSES = ("hidden", "joined", "left out", "split", "remembered")


def classes_of(owners: Ints, labels: Ints, there: int, perceived: int) -> dict[str, int]:
    """Number of fragments of each class in one look.

    Args:
        owners: (n,) true fragment of each point, negative for none.
        labels: (n,) perceived fragment of each point, negative for none.
        there, perceived: number of true and of perceived fragments.
    """
    shared = np.zeros((there, perceived + 1), dtype=np.int64)  # the last column: of no perceived fragment
    of_one = owners >= 0
    np.add.at(shared, (owners[of_one], np.where(labels[of_one] < 0, perceived, labels[of_one])), 1)
    seen = np.flatnonzero(shared.sum(axis=1) >= MIN_POINTS)
    best = shared.argmax(axis=1)
    with_points = np.flatnonzero(shared[:, :perceived].any(axis=0))
    main = shared[:, with_points].argmax(axis=0)  # the true fragment with most points of each perceived one
    owner_of = dict(zip(with_points.tolist(), main.tolist(), strict=True))
    return {
        "hidden": there - len(seen),
        "joined": sum(int(best[i] < perceived and owner_of[int(best[i])] != i) for i in seen),
        "left out": int(np.sum(best[seen] == perceived)),
        "split": len(main) - len(np.unique(main)),
        "remembered": perceived - len(with_points),
    }


def repeated(demonstration: Demonstration, model: Model, world_name: str, seed: int) -> list[dict[str, Any]]:
    """One row for every look while a demonstration is repeated."""
    settings = Settings()
    streams = partial(stream, seed, "wrong counts", demonstration.trial)
    world = make_perceiving(load(reference_of(WORLDS, world_name))(settings, streams), model, settings, streams)
    world.reset(demonstration.start)
    planner, rows = ReplayPlanner(demonstration), list[dict[str, Any]]()
    while True:
        now, truth = world.observe(), world.truth()
        seen = world.sighted(len(rows) + 1)
        row = {"trial": demonstration.trial, "there": len(truth), "too_many": len(now) - len(truth)}
        rows.append(row | classes_of(seen.owners, seen.labels, len(truth), len(now)))
        if len(truth) >= len(demonstration.goal):
            return rows
        cut = planner.next_cut(truth, (), (), stream(seed, "replay", len(rows)))
        if isinstance(cut, Stuck) or not isinstance(world.apply(cut), Done):
            return rows


def summary(trials: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    """Looks and trials with a wrong number, and the looks of each class."""
    looks = [row for rows in trials for row in rows]
    last = [rows[-1]["too_many"] for rows in trials]
    wrong = [row for row in looks if row["too_many"]]
    return {
        "trials": len(trials),
        "too_many_at_the_end": sum(number > 0 for number in last),
        "too_few_at_the_end": sum(number < 0 for number in last),
        "looks": len(looks),
        "wrong_looks": len(wrong),
        "classes": {
            name: {"looks": sum(row[name] > 0 for row in looks), "wrong": sum(row[name] > 0 for row in wrong)}
            for name in CLASSES
        },
    }


def table(numbers: dict[str, Any]) -> str:
    """Format the numbers."""
    lines = [
        f"{numbers['trials']} trials: {numbers['too_many_at_the_end']} end with too many perceived fragments, "
        f"{numbers['too_few_at_the_end']} with too few",
        f"{numbers['looks']} looks, {numbers['wrong_looks']} with a wrong number",
        f"{'a fragment is':16}{'looks':>8}{'wrong':>8}",
    ]
    return "\n".join(
        lines + [f"{name:16}{row['looks']:8d}{row['wrong']:8d}" for name, row in numbers["classes"].items()]
    )


def main() -> int:
    """Measure and print; the exit code is 2 for invalid input."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, metavar="DATA", help="a data set with a split")
    parser.add_argument("--model", type=Path, required=True, metavar="MODEL", help="a model trained with --vision")
    parser.add_argument("--trials", type=int, default=8, help="number of repeated demonstrations (default 8)")
    parser.add_argument("--world", default="kinova", help="world behind the cameras (default kinova)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the noise (default 0)")
    parser.add_argument("--json", action="store_true", help="print every look as JSON")
    chosen = parser.parse_args()
    try:
        source, model = DataSet.open(chosen.data), load_model(chosen.model)
        tests = read_split(source, model.provenance.split).test
        rows = []
        with progress("trials", chosen.trials) as advance:
            for i in np.linspace(0, len(tests) - 1, chosen.trials).astype(int):
                rows.append(repeated(source.demonstration(tests[i]), model, chosen.world, chosen.seed))
                advance()
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(rows) if chosen.json else table(summary(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
