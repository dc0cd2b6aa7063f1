"""What the learned grammar is worth to joint plan fitting: `guided` from five sources of starting plans.

The sources are the setting `fitting.structures`: parse trees of the learned grammar, of one with uniform probabilities,
of one whose productions are shuffled, and two that learned nothing (halving, peeling). Each is evaluated with several
shares of the full budget (`fitting.evaluations`), under all goal conditions, with goals as meshes and as point clouds.

Goals are the test trials of a data set and, for up to 64 fragments, single objects diced into 8, 16, 32, 48 and 64
fragments (`OUT/diced`, with the demonstrator's usual errors); no model is trained on those. With several models each
is a run, and intervals take trials and models as random.

Every budget and source has run folders of its own in `OUT/runs`, which `cutgrammar report`, `show` and `view` read; the
same command resumes. `report` writes `OUT/trials.parquet`, `OUT/summary.json` and one figure for meshes and clouds
each, of what is there so far.

Run: python studies/what_the_grammar_is_worth.py run OUT --data DATA --model MODEL [MODEL ...] [--quick] [--workers N]
     python studies/what_the_grammar_is_worth.py report OUT
"""

import argparse
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cutgrammar.atomic_files import json_bytes, write_atomic
from cutgrammar.errors import InputError
from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.results.samples import Sample, interval_of_mean, n_models, paired_difference
from cutgrammar.results.score_table import Row
from cutgrammar.results.statistics import holm
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings, load_settings
from cutgrammar.storage.data_set import DataSet, write_data_set
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.storage.split import Split, write_split
from cutgrammar.trials.setups import SETUPS
from cutgrammar_dashboards.figures.anytime_picture import AnytimeCurve, AnytimePanel, draw_anytime
from cutgrammar_dashboards.figures.layout.sheet import write_sheet
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.evaluate import evaluate
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.foods import PROPORTIONS

METHOD = "guided"
STRUCTURES = ("grammar", "uniform", "shuffled", "halve", "peel")
GOALS = ("in-place", "scattered", "foreign")
PERCEPTIONS = {"truth": "meshes", "scans": "point clouds"}
SHARES = (0.01, 0.1, 1.0)
DICE = (8, 16, 32, 48, 64)
SIZES = ((2, 8), (9, 16), (17, 32), (33, 64))
"""Smallest and largest number of goal fragments of each group."""
FURTHER = 2000
"""Added to the seed for diced objects, so that they differ from those of the data set."""


def carry_out(options: argparse.Namespace) -> None:
    """Evaluate every source with every budget, the smallest budget first."""
    settings = load_settings(options.settings)
    table, diced = options.data, options.out / "diced"
    dice_objects(diced, options.objects, options.seed, settings)
    for share in sorted(options.shares):
        evaluations = max(1, round(share * settings.fitting.evaluations))
        for structures in options.structures:
            fitting = replace(settings.fitting, structures=structures, evaluations=evaluations)
            for name, data, split in (("table", table, None), ("diced", diced, "diced")):
                for perception in options.perception:
                    print(f"{structures}, {evaluations} evaluations a goal fragment, {name}, {PERCEPTIONS[perception]}")
                    evaluate(
                        EvaluateConfig(
                            data=data,
                            split=split,
                            model=options.model,
                            runs=None if len(options.model) > 1 else options.runs,
                            out=options.out / "runs" / f"{name}-{structures}-{evaluations}",
                            methods=(METHOD,),
                            goals=options.goals,
                            world="bench",
                            perception=perception,
                            trials=options.trials if name == "table" else None,
                            seed=options.seed,
                            settings=replace(settings, fitting=fitting),
                            workers=options.workers,
                        )
                    )


def dice_objects(out: Path, per_size: int, seed: int, settings: Settings) -> None:
    """Make the data set of diced objects, `per_size` of each number of fragments, unless it is there."""
    if (out / "manifest.json").exists():
        return
    foods = {name: load(reference_of(FOODS, name)) for name in PROPORTIONS}
    numbers = [dice for _ in range(per_size) for dice in DICE]
    demonstrations = (
        make_demonstration(i, SETUPS["N1M1"], ("cubes",), foods, seed + FURTHER, settings.demonstrator, dice)
        for i, dice in enumerate([DICE[0], *numbers])
    )
    write_data_set(out, demonstrations, settings.demonstrator, seed + FURTHER)
    # A split needs a training trial; nothing is trained on it.
    write_split(DataSet.open(out), Split("diced", "diced", (0,), tuple(range(1, len(numbers) + 1))))


def trials_in(out: Path) -> list[dict[str, Any]]:
    """The trials of all run folders, each with its source and budget."""
    rows = []
    for file in sorted((out / "runs").glob("*/run.json")):
        facts = read_run(file.parent)
        fitting = facts.settings["fitting"]
        for record in read_records(ledger_of(file.parent)):
            row = Row.of(record, facts)
            rows.append(
                {
                    "structures": fitting["structures"],
                    "evaluations": fitting["evaluations"],
                    "goals": record.key.goals,
                    "perception": record.key.perception,
                    "setup": record.key.setup,
                    "data": row.data,
                    "trial": record.key.trial,
                    "run": record.key.run,
                    "model": row.model,
                    "goal_fragments": record.goal_fragments,
                    "status": record.status,
                    **record.scores,
                    "planning_seconds": record.planning_seconds,
                    "seconds": record.seconds,
                    "digest": record.digest,
                }
            )
    return rows


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means, and differences of the learned grammar from every other source, for every group of trials and budget."""
    means, differences = [], []
    for group, chosen in _groups(rows):
        samples = {name: _sample(r for r in chosen if r["structures"] == name) for name in STRUCTURES}
        for name, sample in samples.items():
            if not sample:
                continue
            times = [r["planning_seconds"] for r in chosen if r["structures"] == name]
            mean = float(np.mean([np.mean(list(v.values())) for v in sample.values()]))
            ends = interval_of_mean(sample, stream(0, "worth", name, *map(str, group.values())))
            counts = {"trials": len(sample), "models": n_models(sample)}
            timing = {"planning_seconds_mean": float(np.mean(times))}
            means.append({**group, "structures": name, **counts, "iou_strict_mean": mean, "ci95": ends, **timing})
            if name == STRUCTURES[0] or not samples[STRUCTURES[0]]:
                continue
            names = ("worth", "against", name, *map(str, group.values()))
            apart = paired_difference(
                _less(samples[STRUCTURES[0]], sample), stream(0, *names, "interval"), stream(0, *names, "test")
            )
            differences.append({**group, "structures": STRUCTURES[0], "against": name, **apart, "p_corrected": None})
    for row, corrected in zip(differences, holm([row["p_value"] for row in differences]), strict=True):
        row["p_corrected"] = corrected
    return {"schema": 1, "means": means, "differences": differences}


def _groups(rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[dict[str, Any], list[Mapping[str, Any]]]]:
    """Goal condition, perception, number of goal fragments and budget, with their trials."""
    for perception in PERCEPTIONS:
        for goals in GOALS:
            for low, high in SIZES:
                of_group = [
                    row
                    for row in rows
                    if (row["perception"], row["goals"]) == (perception, goals) and low <= row["goal_fragments"] <= high
                ]
                for evaluations in sorted({row["evaluations"] for row in of_group}):
                    chosen = [row for row in of_group if row["evaluations"] == evaluations]
                    facts = {"perception": perception, "goals": goals, "fragments": f"{low} to {high}"}
                    yield {**facts, "evaluations": evaluations}, chosen


def _sample(rows: Iterator[Mapping[str, Any]]) -> dict[Any, dict[str, float]]:
    """Trial -> model -> mean strict IoU of its runs.

    Strata are the two sources of goals, not setups, and both sources are tested with the same models, as one data set.
    """
    runs: dict[Any, dict[str, list[float]]] = {}
    for row in rows:
        unit = (row["data"], "", row["trial"])
        runs.setdefault(unit, {}).setdefault(row["model"], []).append(row["iou_strict"])
    return {unit: {model: float(np.mean(scores)) for model, scores in models.items()} for unit, models in runs.items()}


def _less(ours: Mapping[Any, Mapping[str, float]], others: Mapping[Any, Mapping[str, float]]) -> Sample:
    """The difference in every trial with every model that both have."""
    both = {unit: set(ours[unit]) & set(others[unit]) for unit in set(ours) & set(others)}
    return {
        unit: {model: ours[unit][model] - others[unit][model] for model in models}
        for unit, models in both.items()
        if models
    }


def report(out: Path) -> None:
    """Write the trials, their summary and the figures; print the means."""
    rows = trials_in(out)
    if not rows:
        raise InputError(f"{out} holds no trial yet; the command run makes them")
    pq.write_table(pa.Table.from_pylist(rows), out / "trials.parquet", compression="zstd")
    summary = summarise(rows)
    write_atomic(out / "summary.json", json_bytes(summary))
    for perception, word in PERCEPTIONS.items():
        means = [row for row in summary["means"] if row["perception"] == perception]
        if not means:
            continue
        panels = [
            [_panel(goals, f"{low} to {high}", means) for goals in GOALS if any(r["goals"] == goals for r in means)]
            for low, high in SIZES
            if any(row["fragments"] == f"{low} to {high}" for row in means)
        ]
        write_sheet(
            draw_anytime(
                panels,
                f"What the grammar is worth: goals as {word}",
                "guided from five sources of starting plans; bars: 95 % intervals over trials"
                + (" and models" if any(row["models"] > 1 for row in means) else ""),
                "evaluations for each goal fragment",
                "strict IoU",
            ),
            out / f"anytime-{word.replace(' ', '-')}.svg",
        )
        print(out / f"anytime-{word.replace(' ', '-')}.svg")
    for row in summary["means"]:
        ends = "" if row["ci95"] is None else " [{:.3f}, {:.3f}]".format(*row["ci95"])
        where = f"{row['goals']}, {PERCEPTIONS[row['perception']]}, {row['fragments']} fragments"
        print(
            f"{where}, {row['evaluations']} evaluations: {row['structures']} {row['iou_strict_mean']:.3f}{ends}, "
            f"n = {row['trials']}, {row['planning_seconds_mean']:.2f} s"
        )


def _panel(goals: str, fragments: str, means: Sequence[Mapping[str, Any]]) -> AnytimePanel:
    chosen = [row for row in means if (row["goals"], row["fragments"]) == (goals, fragments)]
    curves = []
    for name in STRUCTURES:
        points = sorted((row for row in chosen if row["structures"] == name), key=lambda row: row["evaluations"])
        if points:
            budgets = tuple(float(row["evaluations"]) for row in points)
            scores = tuple(row["iou_strict_mean"] for row in points)
            ends = tuple(None if row["ci95"] is None else (row["ci95"][0], row["ci95"][1]) for row in points)
            curves.append(AnytimeCurve(name, budgets, scores, ends))
    n_trials = max((row["trials"] for row in chosen), default=0)
    return AnytimePanel(f"{goals}, {fragments} fragments", f"n = {n_trials}", tuple(curves))


def parse(words: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run")
    running.add_argument("out", type=Path)
    running.add_argument("--data", type=Path, required=True, help="data set with a split")
    running.add_argument(
        "--model", type=Path, nargs="+", required=True, help="one model, or repetitions of one training"
    )
    running.add_argument("--structures", nargs="+", choices=STRUCTURES, default=STRUCTURES)
    running.add_argument("--shares", type=float, nargs="+", default=SHARES, help="of the full budget")
    running.add_argument("--goals", nargs="+", choices=GOALS, default=GOALS)
    running.add_argument("--perception", nargs="+", choices=tuple(PERCEPTIONS), default=tuple(PERCEPTIONS))
    running.add_argument("--trials", type=int, help="at most so many test trials of each setup (default all)")
    running.add_argument("--objects", type=int, default=6, help="diced objects of each number of fragments (default 6)")
    running.add_argument("--runs", type=int, default=1, help="seeds of planning with a single model (default 1)")
    running.add_argument(
        "--quick", action="store_true", help="two trials of each setup, two diced objects of each size"
    )
    running.add_argument("--settings", type=Path, help="settings file; its fitting.evaluations are the full budget")
    running.add_argument("--seed", type=int, default=0)
    running.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="Ray actors; 0: this process")
    reporting = commands.add_parser("report")
    reporting.add_argument("out", type=Path)
    options = parser.parse_args(words)
    if options.command == "run" and options.quick:
        options.trials, options.objects = 2, 2
    return options


def main(words: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code."""
    options = parse(words)
    try:
        if options.command == "run":
            carry_out(options)
        report(options.out)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
