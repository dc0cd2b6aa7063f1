"""How many records a second one driver takes, and how many nodes it therefore feeds.

    python benchmarks/capacity.py run [--trials 20000] [--workers 200 2000] [--seconds 0 2] [--ray]

RUN is a finished run. The driver is the real one: `carry_out` with its pool, its jobs and its ledger, for `--trials`
planned trials (the records of RUN under new run numbers). Its workers are simulated in this process: each call comes
back `--seconds` after it could begin, with a record of RUN that was pickled before, as Ray would deliver it; jobs are
pickled when they are handed out. With 0 seconds the driver is never idle, and what it does in a second is its limit.
Printed are records a second, processor time a record, the largest memory, and the shares of the time in waiting for
workers, reading jobs, unpickling results and writing the ledger; the rest is the pool's.

`--ray` measures what the simulation leaves out, on real actors that return the same records: processor time of the
driver a record, less that of the simulation, and the time of one `ray.wait` on many calls.
"""

import argparse
import contextlib
import dataclasses
import heapq
import itertools
import json
import os
import pickle
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from cutgrammar.storage.configurations import contents_of
from cutgrammar.storage.ledger import Ledger, read_known_configurations, read_records
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.trials.record import TrialKey
from cutgrammar_pipelines.stages.evaluate import run_trials
from cutgrammar_pipelines.stages.evaluate.reproduce import _reopen
from cutgrammar_pipelines.stages.evaluate.run_trials import Jobs, carry_out
from cutgrammar_workers import actor_pool
from cutgrammar_workers.ray_session import session
from cutgrammar_workers.trial_worker import Job, Outcome
from cutgrammar_workers.worker_actor import Place
from measures.cost import cost_in_own_process, cost_of

RUN = "CUTGRAMMAR_BENCHMARK_RUN"
Identity = tuple[str, int, str, str, int]


class Ready:
    """Returns the outcomes of a run for the jobs of its repetitions.

    Args:
        run: folder of the run.
    """

    def __init__(self, run: Path) -> None:
        records = read_records(ledger_of(run))
        self.keys = [record.key for record in records]
        self.step = 1 + max(key.run for key in self.keys)
        known = read_known_configurations(ledger_of(run), self.keys)
        self._outcomes = {
            self._identity(record.key): pickle.dumps(
                Outcome(record, None, configurations=contents_of(known[record.key]))
            )
            for record in records
        }

    def __call__(self, job: Job) -> bytes:
        """The pickled outcome of the trial that this one repeats."""
        return self._outcomes[self._identity(job.key)]

    def repeated(self, size: int) -> list[TrialKey]:
        """The keys of `size` trials."""
        numbers = (divmod(number, len(self.keys)) for number in range(size))
        return [
            dataclasses.replace(self.keys[place], run=self.keys[place].run + repetition * self.step)
            for repetition, place in numbers
        ]

    def _identity(self, key: TrialKey) -> Identity:
        return key.setup, key.trial, key.goals, key.method, key.run % self.step


class SimulatedRay:
    """What the pool uses of Ray, with actors that are never built.

    Args:
        ready: gives the results.
        seconds: how long a call takes; an actor carries out one after another.
    """

    def __init__(self, ready: Ready, seconds: float) -> None:
        self._ready, self._seconds = ready, seconds
        self._numbers = itertools.count()
        self._due: list[tuple[float, int]] = []
        self._landed: dict[int, None] = {}
        self._actor_of: dict[int, int] = {}
        self._dead: set[int] = set()
        self._free: Counter[int] = Counter()
        self._results: dict[int, tuple[bytes, TrialKey] | Place | bool] = {}
        self.spent: Counter[str] = Counter()

    def remote(self, _: type) -> "SimulatedRay":
        """The class of the actors."""
        return self

    def options(self, **_: Any) -> Any:
        """Makes an actor."""

        class Method:
            def __init__(self, call: Callable[..., int]) -> None:
                self.remote = call

        class Handle:
            def __init__(handle) -> None:  # noqa: N805
                actor = next(self._numbers)
                handle.actor = actor
                handle.place = Method(lambda: self._add(actor, 0.0, Place("node", "host", actor)))
                handle.build = Method(lambda *_: self._add(actor, 0.0, False))
                handle.call = Method(lambda job: self._begin(actor, job))

        return Method(lambda *_: Handle())

    def _add(self, actor: int, due: float, result: tuple[bytes, TrialKey] | Place | bool) -> int:
        reference = next(self._numbers)
        self._results[reference] = result
        self._actor_of[reference] = actor
        heapq.heappush(self._due, (due, reference))
        return reference

    def _begin(self, actor: int, job: Job) -> int:
        with self.timed("pickling jobs"):
            pickle.dumps(job)
        self._free[actor] = max(self._free[actor], time.monotonic()) + self._seconds
        return self._add(actor, self._free[actor], (self._ready(job), job.key))

    def wait(
        self, references: Sequence[int], num_returns: int = 1, timeout: float = 0.0
    ) -> tuple[list[int], list[int]]:
        """As `ray.wait`; `references` are all that have not been got."""
        del references
        with self.timed("waiting"):
            if not self._landed:
                time.sleep(min(timeout, max(0.0, self._due[0][0] - time.monotonic())))
        now = time.monotonic()
        while self._due and len(self._landed) < num_returns and self._due[0][0] <= now:
            reference = heapq.heappop(self._due)[1]
            if self._actor_of[reference] not in self._dead:
                self._landed[reference] = None
        return list(itertools.islice(self._landed, num_returns)), []

    def get(self, reference: int) -> Any:
        """As `ray.get`."""
        del self._landed[reference], self._actor_of[reference]
        result = self._results.pop(reference)
        return self.decoded(*result) if isinstance(result, tuple) else result

    def decoded(self, content: bytes, key: TrialKey) -> Any:
        """The outcome of the trial `key`, from that of the one that it repeats."""
        with self.timed("unpickling results"):
            outcome = pickle.loads(content)  # noqa: S301  # made here
        return dataclasses.replace(outcome, record=dataclasses.replace(outcome.record, key=key))

    def put(self, _: Any) -> None:
        """As `ray.put`."""

    def kill(self, handle: Any) -> None:
        """As `ray.kill`."""
        self._dead.add(handle.actor)
        self._landed = {one: None for one in self._landed if self._actor_of[one] != handle.actor}

    def get_runtime_context(self) -> Any:
        """As Ray's, of a driver on a node without workers."""
        return SimpleNamespace(get_node_id=lambda: "driver")

    @contextlib.contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Add the time of a `with` block."""
        begin = time.perf_counter()
        yield
        self.spent[what] += time.perf_counter() - begin


@contextlib.contextmanager
def simulated(ray: SimulatedRay, workers: int) -> Iterator[None]:
    """Let the pool use simulated workers, and measure what else the driver does."""
    add, task = Ledger.add_all, Jobs.__getitem__

    def timed(what: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any) -> Any:
            with ray.timed(what):
                return call(*arguments)

        return measured

    before = actor_pool.ray, actor_pool.session, actor_pool.cores
    actor_pool.ray, actor_pool.cores = ray, lambda: workers  # type: ignore[assignment]
    actor_pool.session = lambda *_: contextlib.nullcontext()  # type: ignore[assignment]
    Ledger.add_all = timed("writing the ledger", add)  # type: ignore[method-assign]
    Jobs.__getitem__ = timed("reading jobs", task)  # type: ignore[method-assign]
    try:
        yield
    finally:
        actor_pool.ray, actor_pool.session, actor_pool.cores = before  # type: ignore[misc]
        Ledger.add_all, Jobs.__getitem__ = add, task  # type: ignore[method-assign]


class ReadyWorker:
    """What a real actor builds instead of a `TrialWorker`: it returns the outcomes of the run that `RUN` names."""

    def __init__(self, _: Any) -> None:
        self._ready = Ready(Path(os.environ[RUN]))

    def __call__(self, job: Job) -> Outcome:
        """The outcome of the trial that this one repeats."""
        outcome: Outcome = pickle.loads(self._ready(job))  # noqa: S301  # made here
        return dataclasses.replace(outcome, record=dataclasses.replace(outcome.record, key=job.key))


class Sleeper:
    """An actor whose calls do not return."""

    def sleep(self) -> None:
        """Sleep for long."""
        time.sleep(1000.0)


def seconds_of_a_wait(pending: int, repetitions: int = 20) -> float:
    """The time in which Ray finds that none of so many calls has returned [s]."""
    import ray

    with session(1):
        actor = ray.remote(Sleeper).remote()
        calls = [actor.sleep.remote() for _ in range(pending)]
        begin = time.perf_counter()
        for _ in range(repetitions):
            ray.wait(calls, num_returns=1, timeout=0)
        took = time.perf_counter() - begin
        ray.kill(actor)
    return took / repetitions


def drive(run: Path, size: int, workers: int, seconds: float, fetched: bool, real: bool = False) -> dict[str, Any]:
    """Carry out `size` trials with simulated workers; records a second, and the time spent on what [s].

    With `real` they are Ray's, and take no time.
    """
    ready = Ready(run)
    ray = SimulatedRay(ready, seconds)
    if real:
        os.environ[RUN] = str(run.resolve())
        run_trials.TrialWorker = ReadyWorker  # type: ignore[misc,assignment]
    _, context, jobs = _reopen(run, ready.keys[:1], "none")
    keys = ready.repeated(size)
    jobs = dataclasses.replace(jobs, keys=keys, is_fetched=fetched)
    context = dataclasses.replace(context, methods={key.method: "cutgrammar.methods" for key in ready.keys})
    pool = contextlib.nullcontext() if real else simulated(ray, workers)
    with tempfile.TemporaryDirectory() as folder, pool:
        begin, cpu = time.perf_counter(), time.process_time()
        new, _ = carry_out(Path(folder) / "run", read_run(run), jobs, context, workers)
        took, cpu = time.perf_counter() - begin, time.process_time() - cpu
    assert new == size
    return {"rate": size / took, "took": took, "cpu": cpu / size, "spent": ray.spent}


def main() -> None:
    """Measure each case in a process of its own, and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a finished run")
    parser.add_argument("--trials", type=int, default=20_000)
    parser.add_argument("--workers", type=int, nargs="+", default=[200, 2000])
    parser.add_argument("--seconds", type=float, nargs="+", default=[0.0, 2.0], help="of every trial")
    parser.add_argument("--jobs", nargs="+", default=["local", "fetched"], choices=["local", "fetched"])
    parser.add_argument("--ray", action="store_true", help="measure real actors, too")
    parser.add_argument("--case", nargs=3, help="measure this in this process: workers, seconds, jobs")
    options = parser.parse_args()
    if options.case:
        workers, seconds, kind = options.case
        work = (options.run, options.trials, int(workers), float(seconds), kind == "fetched", options.ray)
        print(json.dumps(cost_of(lambda: drive(*work))))
        return
    print(f"{'jobs':>8} {'workers':>7} {'[s]':>5} {'records/s':>9} {'CPU [ms]':>8} {'MB':>6}  shares of the time")
    cases = [("", *case) for case in itertools.product(options.jobs, options.workers, options.seconds)]
    cases += [("--ray", kind, 2, 0.0) for kind in options.jobs if options.ray]
    for real, kind, workers, seconds in cases:
        words = [__file__, str(options.run), "--trials", str(options.trials), *filter(None, [real])]
        cost = cost_in_own_process([*words, "--case", str(workers), str(seconds), kind])
        found = cost["found"]
        shares = ", ".join(f"{what} {share / found['took']:.0%}" for what, share in sorted(found["spent"].items()))
        row = f"{kind:>8} {workers:7} {seconds:5g} {found['rate']:9.0f} {1e3 * found['cpu']:8.2f}"
        print(f"{row} {cost['mb']:6.0f}  {'real actors' if real else shares}", flush=True)
    for pending in (2 * workers for workers in options.workers if options.ray):
        print(f"ray.wait on {pending} calls: {1e3 * seconds_of_a_wait(pending):.2f} ms")


if __name__ == "__main__":
    main()
