"""Many signals to an evaluation on a cluster: no trial may be lost, doubled or changed. Needs root.

    python benchmarks/chaos.py data --model model --seed 1 [--signals 36] [--partitions 4] [--methods random halve]

Evaluates every test trial on the bench, twice: undisturbed on this machine, and on three Ray nodes, each in a network
namespace of its own, with a token. During the second evaluation, SIGKILL, SIGTERM and SIGSTOP hit its workers, raylets,
head and driver. Half of the signals come when a random number of trials is done; a third while the driver starts or
resumes; the others while it writes to MLflow. What was stopped goes on after a random time, or never, if it is a
worker. With --partitions, the cable or the network interface of a node without the driver is down for 5 to 150 s, at
random numbers of trials. Whatever died is started again as an operator would: nodes by `ray start`, the driver by the
same command.

In the end, both ledgers must hold the same records, but for times, both reports without timing must be the same, and
so must be the runs in MLflow after `cutgrammar sync`. Ends with exit code 1 if anything differs.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import mlflow

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from measures.namespaces import PORT, Node, nodes, start

TARGETS = {"worker": 0.4, "raylet": 0.2, "head": 0.12, "driver": 0.28}
"""Part -> probability that a signal is for it."""
SIGNALS = {signal.SIGKILL: 0.5, signal.SIGTERM: 0.25, signal.SIGSTOP: 0.25}
MAX_STOPPED_SECONDS = 25.0
"""Longest time until a stopped process goes on [s]."""
MAX_CUT_OFF_SECONDS = 150.0
"""Longest time until the cable of a node is plugged in again [s]; Ray declares a node dead after about a minute."""
MAX_SECONDS = 5400.0
"""Time limit of the disturbed evaluation [s]."""
PROGRAM = (sys.executable, "-m", "cutgrammar_pipelines")


@dataclass
class Plan:
    """When signals come.

    Attributes:
        by_progress: numbers of trials that are done, at each of which one signal comes.
        starting: number of signals left for starts and resumes of the driver.
        tracking: number of signals left for the time in which the driver writes to MLflow.
        partitions: numbers of trials that are done, at each of which a node without the driver is cut off.
    """

    by_progress: list[int]
    starting: int
    tracking: int
    partitions: list[int]
    made: Counter[tuple[str, str, str]] = field(default_factory=Counter)


@dataclass
class Chaos:
    """The disturbed evaluation.

    Attributes:
        cluster: the nodes; the driver runs on the first.
        command: of the driver.
        run: folder of the run.
        planned: number of trials.
        rng: of this script's choices.
        plan: when signals come.
    """

    cluster: list[Node]
    command: list[str]
    run: Path
    planned: int
    rng: random.Random
    plan: Plan
    log: Path
    driver: subprocess.Popen[bytes] | None = None
    _asleep: dict[int, float] = field(default_factory=dict)
    _cut_off: dict[int, float] = field(default_factory=dict)
    _soon: list[tuple[float, str, str]] = field(default_factory=list)
    _tracking: bool = False
    exits: Counter[int] = field(default_factory=Counter)

    def carry_out(self) -> None:
        """Evaluate until the driver has ended well and all signals have been sent.

        Raises:
            TimeoutError: it takes longer than `MAX_SECONDS`.
        """
        over = time.monotonic() + MAX_SECONDS
        start(self.cluster)
        while True:
            if time.monotonic() > over:
                raise TimeoutError(f"the evaluation has not ended within {MAX_SECONDS:.0f} s; see {self.log}")
            if self.driver is not None and self.driver.poll() is not None:
                code = self.driver.returncode
                self.exits[code] += 1
                self.say(f"driver ended with {code}, {self.done()} trials are done")
                self.driver = None
                if code == 0 and not (self.plan.tracking or self.plan.by_progress or self.plan.partitions):
                    return
            self.mend()
            if self.driver is None:
                self.start_driver()
            self.send_due()
            time.sleep(0.2)

    def mend(self) -> None:
        """Let stopped processes go on and connect nodes when it is time, and start nodes again that have ended."""
        now = time.monotonic()
        for number in [number for number, until in self._cut_off.items() if until <= now]:
            self.connect(number)
        for pid in [pid for pid, until in self._asleep.items() if until <= now]:
            del self._asleep[pid]
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
        ended = [node for node in self.cluster if not (node.is_alive() or node.is_cut_off)]
        if not ended:
            return
        if not self.cluster[0].is_alive():  # all nodes have to join again
            for number in list(self._cut_off):
                self.connect(number)
        driver = [] if self.driver is None else [self.driver.pid]
        for node in self.cluster if not self.cluster[0].is_alive() else ended:
            node.end(but=driver)
        if self.cluster[0] not in ended:
            for node in ended:  # joins while the evaluation goes on
                self.say(f"node {node.number} is started again")
                node.start()
            return
        self.say("the cluster is started again")
        if self.driver is not None:
            self.driver.send_signal(signal.SIGCONT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.driver.wait(90.0)
            if self.driver.poll() is None:
                raise TimeoutError("the driver did not end within 90 s after the head had died")
        start(self.cluster)

    def start_driver(self) -> None:
        """Start the evaluation, or resume it."""
        with self.log.open("ab") as log:
            self.driver = self.cluster[0].run(self.command, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        self._tracking = False
        if self.plan.starting and (self.done() == 0 or self.rng.random() < 0.6):
            self.plan.starting -= 1
            self.soon("start", self.rng.uniform(0.0, 15.0))

    def soon(self, phase: str, after: float, target: str = "") -> None:
        """Plan a signal for `after` seconds from now; to a random part if no target is given."""
        self._soon.append((time.monotonic() + after, phase, target))

    def send_due(self) -> None:
        """Send the signals whose time has come."""
        done = self.done()
        if self.plan.partitions and done >= self.plan.partitions[0] and not self._cut_off:
            self.plan.partitions.pop(0)
            self.cut_off()
        while self.plan.by_progress and done >= self.plan.by_progress[0]:
            self.plan.by_progress.pop(0)
            self.soon("evaluation", self.rng.uniform(0.0, 2.0))
        if done == self.planned and self.plan.tracking and not self._tracking:
            self._tracking = True
            self.plan.tracking -= 1
            self.soon("tracking", self.rng.uniform(0.0, 6.0), "driver")
        due = [item for item in self._soon if item[0] <= time.monotonic()]
        self._soon = [item for item in self._soon if item not in due]
        for _, phase, target in due:
            self.send(phase, target or self.rng.choices(list(TARGETS), list(TARGETS.values()))[0])

    def cut_off(self) -> None:
        """Unplug the cable of a node without the driver, or take down its interface, for a random time."""
        number, part = self.rng.randrange(1, len(self.cluster)), self.rng.choice(["cable", "interface"])
        seconds = self.rng.uniform(5.0, MAX_CUT_OFF_SECONDS)
        self.cluster[number].cut_off(part == "interface")
        self._cut_off[number] = time.monotonic() + seconds
        self.plan.made["evaluation", part, "cut off"] += 1
        self.say(f"evaluation: {part} of node {number} is down for {seconds:.0f} s, {self.done()} trials are done")

    def connect(self, number: int) -> None:
        """Let a node reach the others again."""
        del self._cut_off[number]
        self.cluster[number].connect()
        self.say(f"node {number} is connected again")

    def send(self, phase: str, target: str) -> None:
        """Send a random signal to a process of a part, or try again soon if there is none at this moment."""
        number = self.rng.choices(list(SIGNALS), list(SIGNALS.values()))[0]
        pids = self.pids(target)
        if not pids:  # nothing of this kind runs at this moment
            self.soon(phase, 1.0)
            return
        pid = self.rng.choice(pids)
        self.plan.made[phase, target, number.name] += 1
        self.say(f"{phase}: {number.name} to {target} {pid}, {self.done()} trials are done")
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
        if number == signal.SIGSTOP and (target != "worker" or self.rng.random() < 0.7):
            self._asleep[pid] = time.monotonic() + self.rng.uniform(1.0, MAX_STOPPED_SECONDS)

    def pids(self, target: str) -> list[int]:
        """The processes of a part."""
        if target == "driver":
            return [] if self.driver is None or self.driver.poll() is not None else [self.driver.pid]
        if target == "head":
            return self.cluster[0].pids("gcs_server")
        if target == "raylet":
            return self.rng.choice(self.cluster).pids("/raylet")
        return [
            pid
            for node in self.cluster
            for pid, line in node.processes().items()
            if line.startswith("ray::") and not line.startswith(("ray::DashboardAgent", "ray::RuntimeEnvAgent"))
        ]

    def done(self) -> int:
        """Number of trials with a record."""
        return rows(ledger_of(self.run))

    def say(self, text: str) -> None:
        """Print a line and write it between those of the driver."""
        line = f"{time.strftime('%H:%M:%S')} {text}"
        print(line, flush=True)
        with self.log.open("a") as log:
            log.write(f"--- {line}\n")


def rows(ledger: Path) -> int:
    """Number of records; 0 where no ledger is yet."""
    if not ledger.exists():
        return 0
    try:
        with contextlib.closing(sqlite3.connect(f"file:{ledger}?mode=ro", uri=True, timeout=60.0)) as connection:
            return int(connection.execute("SELECT count(*) FROM records").fetchone()[0])
    except sqlite3.OperationalError:  # its tables are not there yet
        return 0


def digests(run: Path) -> dict[str, str]:
    """Trial -> digest of its record, without times."""
    return {record.key.name: record.digest for record in read_records(ledger_of(run))}


def report(run: Path) -> str:
    """The report without timing, as JSON."""
    words = [*PROGRAM, "report", "--runs", str(run), "--json", "--no-timing"]
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def tracked(store: str) -> dict[str, list[str]]:
    """The runs in MLflow: name and metrics of each, and how often it is there."""
    client = mlflow.MlflowClient(store)
    found = client.search_runs([experiment.experiment_id for experiment in client.search_experiments()])
    timing = ("seconds", "system/")
    told: dict[str, list[str]] = {}
    for run in found:
        metrics = {name: value for name, value in run.data.metrics.items() if not any(part in name for part in timing)}
        told.setdefault(str(run.info.run_name), []).append(json.dumps([run.info.status, metrics], sort_keys=True))
    return {name: sorted(values) for name, values in told.items()}


def main() -> int:
    """Read the command line and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0, help="of signals and times")
    parser.add_argument("--signals", type=int, default=36)
    parser.add_argument("--partitions", type=int, default=0, help="how often a node is cut off from the others")
    parser.add_argument("--nodes", type=int, default=3)
    parser.add_argument("--max-seconds", type=float, default=90.0, help="time limit of a trial")
    parser.add_argument("--network", type=int, default=7, help="number of the network; another for each cluster")
    parser.add_argument("--methods", nargs="+", default=["random", "largest", "halve", "grammar"])
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--trials", type=int, help="of each setup; all if not given")
    parser.add_argument("--keep", type=Path, help="folder in which everything stays; a temporary one if not given")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        return compare(given, folder)


def compare(given: argparse.Namespace, folder: Path) -> int:
    """Evaluate undisturbed and disturbed; 1 if the results differ."""
    settings = folder / "settings.toml"
    settings.write_text(f"[trial]\nmax_seconds = {given.max_seconds}\n")
    quiet, chaotic = folder / "undisturbed" / "run", folder / "disturbed" / "run"
    stores = {run: f"sqlite:///{run.parent / 'mlflow.db'}" for run in (quiet, chaotic)}
    words = ["evaluate", "--data", str(given.data), "--model", str(given.model), "--world", "bench"]
    words += ["--methods", *given.methods, "--runs", str(given.runs), "--settings", str(settings)]
    words += [] if given.trials is None else ["--trials", str(given.trials)]
    for run in stores:
        run.parent.mkdir(exist_ok=True)
    subprocess.run(
        [*PROGRAM, *words, "--out", str(quiet)], check=True, env={**os.environ, "MLFLOW_TRACKING_URI": stores[quiet]}
    )
    planned = rows(ledger_of(quiet))
    rng = random.Random(given.seed)
    starting, tracking = given.signals // 3, given.signals // 6
    by_progress = sorted(rng.randrange(planned) for _ in range(given.signals - starting - tracking))
    partitions = sorted(rng.randrange(planned) for _ in range(given.partitions))
    with nodes(given.nodes, 1, folder, given.network) as cluster:
        for node in cluster:
            node.environment = {**node.environment, "MLFLOW_TRACKING_URI": stores[chaotic]}
        command = [*PROGRAM, *words, "--out", str(chaotic), "--address", f"{cluster[0].address}:{PORT}"]
        command += ["--workers", str(given.nodes)]
        plan = Plan(by_progress, starting, tracking, partitions)
        chaos = Chaos(cluster, command, chaotic, planned, rng, plan, folder / "driver.log")
        began = time.monotonic()
        chaos.carry_out()
        seconds = time.monotonic() - began
    subprocess.run(
        [*PROGRAM, "sync", str(chaotic)], check=True, env={**os.environ, "MLFLOW_TRACKING_URI": stores[chaotic]}
    )
    return tell(chaos, seconds, quiet, stores)


def tell(chaos: Chaos, seconds: float, quiet: Path, stores: dict[Path, str]) -> int:
    """Print what was sent and what differs; 1 if anything does."""
    print(f"{chaos.planned} trials, {chaos.plan.made.total()} faults, {seconds:.0f} s")
    print(f"exits of the driver: {dict(chaos.exits)}")
    for (phase, target, name), count in sorted(chaos.plan.made.items()):
        print(f"  {phase:<10} {target:<9} {name:<8} {count}")
    expected, found = digests(quiet), digests(chaos.run)
    lost, more = expected.keys() - found.keys(), found.keys() - expected.keys()
    changed = [name for name in expected.keys() & found.keys() if expected[name] != found[name]]
    doubled = rows(ledger_of(chaos.run)) - len(found)
    print(f"lost {len(lost)}, not planned {len(more)}, doubled {doubled}, changed {len(changed)} {sorted(changed)[:5]}")
    same_report = report(quiet) == report(chaos.run)
    same_tracking = tracked(stores[quiet]) == tracked(stores[chaos.run])
    print(f"report without timing {'the same' if same_report else 'DIFFERS'}")
    print(f"runs in MLflow {'the same' if same_tracking else 'DIFFER'}")
    return int(bool(lost or more or doubled or changed or not same_report or not same_tracking))


if __name__ == "__main__":
    sys.exit(main())
