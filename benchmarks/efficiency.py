"""How many trials `evaluate` carries out a second and a core, against a plain loop over the same trials.

    python benchmarks/efficiency.py data --model model [--worlds bench kinova]

The plain loop calls the same `TrialWorker` with the same jobs, one after another in one process without Ray, ledger and
MLflow; what `evaluate` adds to it is measured as whole commands with one worker and with two. Every process has one
thread, and nothing else should run. Two loops at once show what the machine itself takes when two of its cores work.

A machine's speed varies from minute to minute, by more than what is measured here. So all ways go on at the same time
and take turns of some seconds, in which the processes of the others are stopped, until all trials are done. The turns
of two workers are half as long, so that all ways go through the trials side by side and meet the same minutes. The
first turn of a way lasts until its first trial has ended: Ray gives up if it is stopped while it starts. The steady
state is the time of a way's own turns from when its first trials had ended until one of its cores had no trial left;
what happens before (imports, compiled code, Ray) and after (the last trial of the other core, report, MLflow) is in the
time of its whole process only.
Ends with exit code 1 if a ratio of the steady state is under .9.
"""

import argparse
import itertools
import os
import sqlite3
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from pathlib import Path

import psutil

from cutgrammar.storage.ledger import read_planned, read_statuses
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.record import TrialKey
from cutgrammar_pipelines.stages.evaluate.reproduce import worker_for
from cutgrammar_workers.one_thread import ONE_THREAD

WANTED = 0.9
COMMAND = [sys.executable, "-m", "cutgrammar_pipelines"]
LOOP, TWO_LOOPS, WORKERS = "loop", "two loops at once", {"1 worker": 1, "2 workers": 2}
CORES = {LOOP: 1, TWO_LOOPS: 2, **WORKERS}

Turn = tuple[float, float]
"""Begin and end [s], as `time.time` gives them."""


def in_order(keys: Sequence[TrialKey], methods: Sequence[str]) -> list[TrialKey]:
    """The keys in the order in which `evaluate` carries them out, but for that of setups and trials."""
    return sorted(keys, key=lambda key: (key.run, key.setup, key.trial, methods.index(key.method)))


def loop(run: Path, methods: Sequence[str]) -> None:
    """Carry out the trials of a run folder again, one after another, and print when each has ended."""
    keys = in_order(read_planned(ledger_of(run)), methods)
    worker, jobs = worker_for(run, keys, record="none")
    for index in range(len(jobs)):
        worker(jobs[index])
        print(time.time(), flush=True)


class Way:
    """One way to carry out the trials, as processes that work only while they have their turn.

    Args:
        commands: the processes, which work at the same time.
        folder: for what they print.
        run: the run folder that they fill; None if they print when trials have ended.
        environment: of the processes.
    """

    def __init__(
        self, commands: Sequence[Sequence[str]], folder: Path, run: Path | None, environment: dict[str, str]
    ) -> None:
        folder.mkdir()
        self.turns: list[Turn] = []
        self._commands, self._run, self._environment = commands, run, environment
        self._outputs = [folder / f"output{i}" for i in range(len(commands))]
        self._processes: list[psutil.Popen] = []

    def work(self, seconds: float) -> bool:
        """Go on for so long, at first until trials have ended; False if all processes have ended."""
        began = time.time()
        if not self._processes:
            for command, output in zip(self._commands, self._outputs, strict=True):
                with output.open("wb") as out, output.with_suffix(".err").open("wb") as err:
                    self._processes.append(psutil.Popen(command, env=self._environment, stdout=out, stderr=err))
        for process in reversed(list(self._all())):
            with suppress(psutil.NoSuchProcess):
                process.resume()
        while any(process.poll() is None for process in self._processes):
            if time.time() > began + seconds and (self.turns or all(self.ends())):
                break
            time.sleep(0.02)
        for process in self._all():
            with suppress(psutil.NoSuchProcess):
                process.suspend()
        self.turns.append((began, time.time()))
        return any(process.poll() is None for process in self._processes)

    def check(self) -> None:
        """Exit if one of the processes has failed, or one of the trials."""
        statuses = set() if self._run is None else set(read_statuses(ledger_of(self._run)).values())
        if any(process.returncode for process in self._processes) or statuses & {"crashed", "timeout"}:
            errors = "\n".join(output.with_suffix(".err").read_text()[-2000:] for output in self._outputs)
            sys.exit(f"{self._commands}\n{statuses}\n{errors}")

    def ends(self) -> list[list[float]]:
        """When the trials had ended [s], ascending: of each process that carried out all of them."""
        if self._run is None:
            return [list(map(float, output.read_text().split())) for output in self._outputs]
        if not ledger_of(self._run).exists():
            return [[]]
        with closing(sqlite3.connect(ledger_of(self._run))) as connection:
            return [[ended for (ended,) in connection.execute("SELECT ended FROM attempts ORDER BY ended")]]

    def _all(self) -> Iterator[psutil.Process]:
        """The processes and all that they started, parents first, so that one that is stopped starts none unseen."""
        waiting: list[psutil.Process] = list(self._processes)
        while waiting:
            process = waiting.pop(0)
            yield process
            with suppress(psutil.NoSuchProcess):
                waiting += process.children()


def active(turns: Sequence[Turn], begin: float, end: float) -> float:
    """How much of the time from `begin` to `end` lies in turns [s]."""
    return sum(max(0.0, min(end, last) - max(begin, first)) for first, last in turns)


def steady_rate(turns: Sequence[Turn], ends: Sequence[Sequence[float]], skip: int, workers: int) -> float:
    """Trials a second of own turns, from when the first `skip` trials had ended until a core had no trial left.

    Args:
        turns: of the way.
        ends: for each process that carried out all trials, when they had ended [s], ascending.
        skip: number of trials that are not counted.
        workers: that such a process keeps busy.
    """
    begin, end = max(one[skip - 1] for one in ends), min(one[-workers] for one in ends)
    count = sum(sum(begin < moment <= end for moment in one) for one in ends)
    return count / active(turns, begin, end)


def measure(options: argparse.Namespace, world: str, folder: Path) -> dict[str, tuple[float, float]]:
    """Way -> trials a second and core, in the steady state and of the whole process."""
    environment = {
        **os.environ,
        **ONE_THREAD,
        "MLFLOW_TRACKING_URI": f"sqlite:///{(folder / 'mlflow.db').resolve()}",
    }

    def evaluation(name: str, workers: int) -> Way:
        words = ["evaluate", "--data", str(options.data), "--model", str(options.model), "--out", str(folder / name)]
        words += ["--world", world, "--setups", *options.setups, "--trials", str(options.trials), "--quiet"]
        words += ["--methods", *options.methods, "--runs", str(options.runs), "--workers", str(workers)]
        return Way([[*COMMAND, *words]], folder / f"{name} output", folder / name, environment)

    known = evaluation("known", 2)  # fills numba's cache, too
    while known.work(1.0):
        pass
    known.check()
    again = [sys.executable, __file__, str(folder / "known"), "--loop", "--methods", *options.methods]
    ways = {
        name: Way([again] * CORES[name], folder / f"{name} output", None, environment) for name in (LOOP, TWO_LOOPS)
    }
    ways |= {name: evaluation(name, workers) for name, workers in WORKERS.items()}
    left = dict(ways)
    for number in itertools.count():
        for name in list(left)[:: -1 if number % 2 else 1]:
            if not left[name].work(options.turn / WORKERS.get(name, 1)):
                ways[name].check()
                del left[name]
        if not left:
            break
    count = len(read_planned(ledger_of(folder / "known")))
    found = {}
    for name, way in ways.items():
        ends, whole = way.ends(), active(way.turns, way.turns[0][0], way.turns[-1][1])
        steady = steady_rate(way.turns, ends, options.skip, WORKERS.get(name, 1))
        found[name] = (steady / CORES[name], count * len(ends) / whole / CORES[name])
    return found


def main() -> int:
    """Measure each world and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="data set with a split")
    parser.add_argument("--model", type=Path)
    parser.add_argument("--worlds", nargs="+", default=["bench", "kinova"])
    parser.add_argument("--methods", nargs="+", default=["grammar"])
    parser.add_argument("--setups", nargs="+", default=["N1M1", "N2M1"])
    parser.add_argument("--trials", type=int, default=12, help="trials of each setup")
    parser.add_argument("--runs", type=int, default=4, help="runs of every trial")
    parser.add_argument("--skip", type=int, default=6, help="first trials that are not counted")
    parser.add_argument("--turn", type=float, default=4.0, help="how long a way works at a time [s]; two workers half")
    parser.add_argument("--repetitions", type=int, default=1)
    parser.add_argument("--loop", action="store_true", help="only the plain loop over run folder DATA")
    options = parser.parse_args()
    if options.loop:
        loop(options.data, options.methods)
        return 0
    slow = False
    print(f"{'world':8} {'way':>18} {'steady [1/s/core]':>17} {'ratio':>6} {'whole [1/s/core]':>17} ratio")
    for world in options.worlds * options.repetitions:
        with tempfile.TemporaryDirectory() as folder:
            found = measure(options, world, Path(folder))
        for name, (steady, whole) in found.items():
            ratio = steady / found[LOOP][0]
            slow |= name in WORKERS and ratio < WANTED
            print(
                f"{world:8} {name:>18} {steady:17.3f} {ratio:6.2f} {whole:17.3f} {whole / found[LOOP][1]:5.2f}",
                flush=True,
            )
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
