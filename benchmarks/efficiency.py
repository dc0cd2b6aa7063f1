"""How many trials `evaluate` carries out a second and a core, against a plain loop over the same trials.

    python benchmarks/efficiency.py data --model model [--worlds bench kinova] [--repetitions 3]

The plain loop calls the same `TrialWorker` with the same jobs, one after another in one process without Ray, ledger and
MLflow; what `evaluate` adds to it is measured as whole commands with one worker and with two. Every process has one
thread, and nothing else should run. Two loops at once show what the machine itself takes when two of its cores work.

Each is carried out for a few trials of every setup and for many. Differences of the two give the steady state, in which
what happens once (imports, Ray, the report) or once a run (MLflow) cancels on both sides; the whole long command is
printed, too. Compiled code is in numba's cache before anything is timed.
Ends with exit code 1 if a ratio of the steady state (median of the repetitions) is under .9.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from cutgrammar.storage.ledger import read_planned, read_statuses
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.record import TrialKey
from cutgrammar_pipelines.stages.evaluate.reproduce import worker_for
from cutgrammar_workers.one_thread import ONE_THREAD

WANTED = 0.9
COMMAND = [sys.executable, "-m", "cutgrammar_pipelines"]
LOOP, TWO_LOOPS, WORKERS = "loop", "two loops at once", {"1 worker": 1, "2 workers": 2}
CORES = {LOOP: 1, TWO_LOOPS: 2, **WORKERS}


def in_order(keys: Sequence[TrialKey], methods: Sequence[str]) -> list[TrialKey]:
    """The keys in the order in which `evaluate` carries them out, but for that of setups and trials."""
    return sorted(keys, key=lambda key: (key.run, key.setup, key.trial, methods.index(key.method)))


def loop(run: Path, methods: Sequence[str]) -> None:
    """Carry out the trials of a run folder again, one after another."""
    keys = in_order(read_planned(ledger_of(run)), methods)
    worker, jobs = worker_for(run, keys, record="none")
    for index in range(len(jobs)):
        worker(jobs[index])


class Measurement:
    """Times of the same trials in one world."""

    def __init__(self, options: argparse.Namespace, world: str, folder: Path) -> None:
        self._options, self._world, self._folder = options, world, folder
        self._count = 0
        self.environment = {
            **os.environ,
            **ONE_THREAD,
            "MLFLOW_TRACKING_URI": f"sqlite:///{(folder / 'mlflow.db').resolve()}",
        }
        self._known = {trials: self._evaluate(0, trials)[0] for trials in options.trials}  # also fills numba's cache
        self.sizes = tuple(len(read_planned(ledger_of(run))) for run in self._known.values())

    def seconds(self, what: str, trials: int) -> float:
        """The time of a whole process, or of two at once."""
        if what in WORKERS:
            return self._evaluate(WORKERS[what], trials)[1]
        command = [sys.executable, __file__, str(self._known[trials]), "--loop", "--methods", *self._options.methods]
        began = time.perf_counter()
        processes = [subprocess.Popen(command, env=self.environment) for _ in range(CORES[what])]
        codes = [process.wait() for process in processes]
        if any(codes):
            sys.exit("a loop failed")
        return time.perf_counter() - began

    def _evaluate(self, workers: int, trials: int) -> tuple[Path, float]:
        options, self._count = self._options, self._count + 1
        out = self._folder / self._world / str(self._count)
        command = [*COMMAND, "evaluate", "--data", str(options.data), "--model", str(options.model), "--out", str(out)]
        command += ["--world", self._world, "--setups", *options.setups, "--trials", str(trials), "--quiet"]
        command += ["--methods", *options.methods, "--runs", str(options.runs), "--workers", str(workers)]
        began = time.perf_counter()
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True)
        seconds = time.perf_counter() - began
        if done.returncode or set(read_statuses(ledger_of(out)).values()) & {"crashed", "timeout"}:
            sys.exit(f"{' '.join(command)}\n{done.stdout}\n{done.stderr}")
        return out, seconds


def rates(what: str, times: Sequence[float], sizes: Sequence[int]) -> tuple[float, float]:
    """Trials a second and a core: in the steady state, and of the whole long command.

    Args:
        what: which of the ways; two loops carry out the trials twice.
        times: of the short and of the long process [s].
        sizes: numbers of trials of the two.
    """
    once = 1.0 if what in (LOOP, TWO_LOOPS) else 1.0 / CORES[what]
    return once * (sizes[1] - sizes[0]) / (times[1] - times[0]), once * sizes[1] / times[1]


def measured(
    seconds: Callable[[str, int], float], trials: Sequence[int], sizes: Sequence[int], repetitions: int
) -> dict[str, list[tuple[float, float]]]:
    """Way -> its rates in each repetition, in which the ways come in turn, every second time backwards."""
    found: dict[str, list[tuple[float, float]]] = {what: [] for what in CORES}
    for repetition in range(repetitions):
        for what in list(CORES)[:: -1 if repetition % 2 else 1]:
            times = [seconds(what, number) for number in trials]
            found[what].append(rates(what, times, sizes))
            print(f"# {repetition} {what}: {times[0]:.1f} s, {times[1]:.1f} s", file=sys.stderr, flush=True)
    return found


def ratios(found: Mapping[str, Sequence[tuple[float, float]]], what: str, which: int) -> list[float]:
    """The rates of a way by those of the loop, repetition by repetition."""
    return [one[which] / of_loop[which] for one, of_loop in zip(found[what], found[LOOP], strict=True)]


def main() -> int:
    """Measure each world and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="data set with a split")
    parser.add_argument("--model", type=Path)
    parser.add_argument("--worlds", nargs="+", default=["bench", "kinova"])
    parser.add_argument("--methods", nargs="+", default=["grammar"])
    parser.add_argument("--setups", nargs="+", default=["N1M1", "N2M1"])
    parser.add_argument("--trials", type=int, nargs=2, default=[2, 12], help="trials of each setup, short and long")
    parser.add_argument("--runs", type=int, default=2, help="runs of every trial")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--loop", action="store_true", help="only the plain loop over run folder DATA")
    options = parser.parse_args()
    if options.loop:
        loop(options.data, options.methods)
        return 0
    slow = False
    print(
        f"{'world':8} {'way':>18} {'trials':>6} {'steady [1/s/core]':>17} {'ratio':>6} {'whole [1/s/core]':>17} ratio"
    )
    for world in options.worlds:
        with tempfile.TemporaryDirectory() as folder:
            measurement = Measurement(options, world, Path(folder))
            found = measured(measurement.seconds, options.trials, measurement.sizes, options.repetitions)
            for what, pairs in found.items():
                steady, whole = (statistics.median(pair[which] for pair in pairs) for which in (0, 1))
                first, second = (statistics.median(ratios(found, what, which)) for which in (0, 1))
                row = f"{world:8} {what:>18} {measurement.sizes[1]:6} {steady:17.3f} {first:6.2f} {whole:17.3f}"
                print(f"{row} {second:5.2f}", flush=True)
                slow |= what in WORKERS and first < WANTED
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
