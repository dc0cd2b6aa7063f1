"""Time and memory of collecting, reading, splitting, planning and training at several numbers of trials.

    python benchmarks/data_scale.py [--sizes 500 2000] [--repeated 10000] [--what collect read split plan train]

Data sets of `--sizes` are collected; those of `--repeated` are made by repeating the trials of the largest of them
under new numbers. Every figure is of a process of its own: processor time, time, time a trial and the largest memory.
`read` opens the data set, checks its digests and reads every demonstration; `plan` is what `evaluate` does before and
between trials: it plans in-place and foreign goals and reads the demonstration of every trial in turn. `train` has the
paper's split, with 16 of 110 trials, and `--epochs` for all networks; time a trial is of the training trials.
"""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet, new_data_set
from cutgrammar.storage.split import make_split, read_split, write_split
from cutgrammar.storage.stored_demonstrations import StoredDemonstrations
from cutgrammar.storage.tables import renumbered
from cutgrammar.trials.record import TrialKey
from cutgrammar_pipelines.config import CollectConfig, TrainConfig
from cutgrammar_pipelines.stages.collect import collect
from cutgrammar_pipelines.stages.evaluate.plan_trials import donor_pool
from cutgrammar_pipelines.stages.evaluate.run_trials import Jobs
from cutgrammar_pipelines.stages.train import train
from measures.cost import cost_in_own_process, cost_of

WHAT = ("collect", "read", "split", "plan", "train")
ORIGIN = "0" * 64


def repeat(source: DataSet, out: Path, size: int) -> int:
    """Make a data set of `size` trials from those of `source`, again and again."""
    with new_data_set(out, None, None, source.foods) as add:
        for number in range(size):
            add(renumbered(source.tables(source.trials[number % len(source.trials)].trial), number))
    return size


def read(data: Path) -> int:
    """Open the data set and read every demonstration."""
    source = DataSet.open(data)
    return sum(1 for _ in StoredDemonstrations(source, [trial.trial for trial in source.trials]))


def split(data: Path) -> int:
    """Make and write the paper's split."""
    source = DataSet.open(data)
    write_split(source, make_split(source))
    return len(source.trials)


def plan(data: Path) -> int:
    """What `evaluate` does with a data set, without carrying out trials."""
    source = DataSet.open(data)
    chosen = read_split(source)
    donors = donor_pool(source, chosen, [], 0)
    keys = [
        TrialKey(source.summary(trial).setup, trial, goals, "random", 0, "bench", "truth", ORIGIN)
        for trial in chosen.test
        for goals in ("in-place", "foreign")
    ]
    jobs = Jobs(source, keys, donors)
    return sum(jobs[index].key.trial >= 0 for index in range(len(jobs)))


def learn(data: Path, epochs: int) -> int:
    """Train on the training trials of the paper's split."""
    settings = Settings()
    tables = {
        name: replace(getattr(settings, name), epochs=epochs) for name in ("features", "classifier", "planes")
    } | {"baselines": replace(settings.baselines, epochs=epochs, plane_epochs=epochs)}
    with tempfile.TemporaryDirectory() as folder:
        config = TrainConfig(data=data, out=Path(folder, "model"), settings=replace(settings, **tables))
        return len(train(config).model.provenance.trials)


def measure(what: str, data: Path, size: int, epochs: int) -> None:
    """Do it in this process, and print what it cost as JSON; `found` is the number of trials."""
    work = {
        "collect": lambda: len(collect(CollectConfig(out=data, trials=size, workers=0)).trials),
        "repeat": lambda: repeat(DataSet.open(data.parent / "source"), data, size),
        "read": lambda: read(data),
        "split": lambda: split(data),
        "plan": lambda: plan(data),
        "train": lambda: learn(data, epochs),
    }[what]
    print(json.dumps(cost_of(work)))


def main() -> None:
    """Make the data sets, and measure each figure in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[500, 2000], help="numbers of trials to collect")
    parser.add_argument("--repeated", type=int, nargs="*", default=[10_000], help="numbers of trials by repetition")
    parser.add_argument("--source", type=Path, help="repeat this data set, and collect none")
    parser.add_argument("--what", nargs="+", default=WHAT, choices=WHAT)
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--measure", nargs=3, metavar=("WHAT", "DATA", "SIZE"), help="measure this in this process")
    options = parser.parse_args()
    if options.measure:
        what, data, size = options.measure
        measure(what, Path(data), int(size), options.epochs)
        return
    print(f"{'trials':>7} {'what':>8} {'CPU [s]':>8} {'time [s]':>9} {'ms a trial':>11} {'MB':>6}")
    with tempfile.TemporaryDirectory() as folder:
        if options.source:
            (Path(folder) / "source").symlink_to(options.source.resolve())
        made = [] if options.source else [("collect", size) for size in sorted(options.sizes)]
        for how, size in made + [("repeat", size) for size in options.repeated]:
            data = Path(folder) / f"{how}-{size}"
            for what in (how, *(what for what in WHAT[1:] if what in {"split", *options.what})):
                words = [__file__, "--epochs", str(options.epochs), "--measure", what, str(data), str(size)]
                cost = cost_in_own_process(words)
                each = 1e3 * cost["seconds"] / cost["found"]
                row = f"{size:7} {what:>8} {cost['cpu']:8.1f} {cost['seconds']:9.1f} {each:11.1f} {cost['mb']:6.0f}"
                print(row, flush=True)
            if how == "collect":
                (Path(folder) / "source").unlink(missing_ok=True)
                (Path(folder) / "source").symlink_to(data)


if __name__ == "__main__":
    main()
