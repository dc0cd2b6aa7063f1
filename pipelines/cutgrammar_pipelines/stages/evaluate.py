"""Evaluate methods: plan and cut every test trial, and keep a record of each in the run folder's ledger."""

import os
import platform
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

from cutgrammar import plugins
from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError, one_of
from cutgrammar.learning.model import Model, load_model
from cutgrammar.methods.registry import find_method
from cutgrammar.settings import Settings, from_tables
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import Ledger, read_records
from cutgrammar.storage.run_folder import RunFacts, difference, ledger_of, read_run, recording_of, settle_run
from cutgrammar.storage.split import Split, read_split
from cutgrammar.trials.goals import GOALS
from cutgrammar.trials.record import TrialKey, record_of_death
from cutgrammar.trials.scores import computed_scores, load_score
from cutgrammar.trials.setups import SETUPS, setup_named
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import Crashed
from cutgrammar_workers.trial_worker import PERCEPTIONS, RECORD, EvaluationContext, Job, Outcome, TrialWorker

RECORDER = "cutgrammar_dashboards.recording.recorder:make_recorder"


@dataclass(frozen=True)
class Summary:
    """How an evaluation ended.

    Attributes:
        planned: number of trials asked for.
        present: how many of them the ledger holds.
        new: how many of those were carried out now.
        stuck, failed, crashed: how many ended so.
    """

    planned: int
    present: int
    new: int
    stuck: int
    failed: int
    crashed: int

    @property
    def failures(self) -> int:
        """Trials in which the world failed or something crashed."""
        return self.failed + self.crashed

    @property
    def complete(self) -> bool:
        """Every trial planned has its record."""
        return self.present == self.planned

    def __str__(self) -> str:
        if self.complete and not self.new:
            told = f"finished before: nothing was left to do, {self.present} of {self.planned} trials are there"
        else:
            told = f"{self.present} of {self.planned} trials are there, {self.new} of them new"
        return f"{told}; {self.stuck} stuck, {self.failed} failed, {self.crashed} crashed"


def evaluate(
    data: Path,
    model: Path,
    out: Path,
    *,
    methods: Sequence[str] | None = None,
    setups: Sequence[str] | None = None,
    runs: int = 5,
    trials: int | None = None,
    goals: Sequence[str] = ("in-place",),
    world: str = "kinova",
    perception: str = "truth",
    planners: int = 1,
    record: str = "none",
    workers: int | None = None,
    address: str | None = None,
    seed: int = 0,
    settings: Settings | None = None,
    split: str | None = None,
    allow_missing: bool = False,
) -> Summary:
    """Carry out all trials that the run folder `out` does not have yet.

    Args:
        data: a data set with a split.
        model: a trained model.
        out: the run folder, new or to be gone on with.
        methods: by name; None for all that are installed.
        setups: by name; None for all that have test trials.
        runs: seeds of planning and execution for every trial.
        trials: at most so many test trials of each setup, those with the lowest numbers; None for all.
        goals: goal conditions, of `trials.goals.GOALS`.
        world: where cuts are made, by name.
        perception: what planners see, of `PERCEPTIONS`.
        planners: processes that share each search; changes no plan.
        record: which trials are kept as recordings, of `trial_worker.RECORD`.
        workers: Ray actors, as many as CPUs by default; 0 works in this process.
        address: a running Ray cluster to join.
        seed: of the evaluation.
        settings: of search, worlds and trials.
        split: which split's test trials; None for the one that the model was trained on.
        allow_missing: go on without parts of the data set that are missing or torn.

    Raises:
        InputError: data, model, names or the run folder do not fit.
    """
    settings = settings or Settings()
    workers = (os.cpu_count() or 1) if workers is None else workers
    check_names(methods, goals, world, record)
    one_of("perception", perception, PERCEPTIONS)
    for name, number in (("runs", runs), ("planners", planners), ("trials", 1 if trials is None else trials)):
        if number < 1:
            raise InputError(f"{name} {number} is too small; 1 is the least")
    if planners > 1 and workers < 1:
        raise InputError(f"planners {planners} need Ray, and workers 0 does without it; give workers 1 or more")
    names = list(dict.fromkeys(methods or plugins.names_in(plugins.METHODS)))
    conditions = list(dict.fromkeys(goals))
    applicable = applicable_goals(names, conditions)

    source, learned = DataSet.open(data, allow_missing), load_model(model)
    if perception == "cameras" and learned.segmentation is None:
        raise InputError(
            f"the model {model} has not learned to see, which perception by cameras needs; "
            "train one with: cutgrammar train --vision"
        )
    shared = _shared(seed, settings, learned, names, world, perception, planners, record)
    tests = read_split(source, split or learned.provenance.split)
    facts = _facts(source, learned, tests, seed, settings, model)
    keys = [
        TrialKey(source.summary(trial).setup, trial, condition, method, run, world, perception, facts.origin)
        for run in range(runs)
        for trial in _planned(source, tests, learned, setups, trials)
        for condition in conditions
        for method in names
        if condition in applicable[method]
    ]
    settle_run(out, facts)
    with Ledger(ledger_of(out)) as ledger:
        ledger.plan(keys)
        there = ledger.keys()
        missing = [key for key in keys if key.digest not in there]
        _carry_out(out, ledger, Jobs(source, missing), shared, len(keys), workers, address)
    summary = _summary(out, keys, len(missing))
    print(f"{out}: {summary}")
    return summary


def check_names(methods: Sequence[str] | None, goals: Sequence[str], world: str, record: str) -> None:
    """Pass if `evaluate` knows all of these: to be asked before long work that leads up to it.

    Raises:
        InputError: a name is unknown, or no goal condition is asked for.
    """
    for name in methods or ():
        one_of("method", name, plugins.names_in(plugins.METHODS))
    for name in goals:
        one_of("goal condition", name, GOALS)
    if not goals:
        raise InputError(f"no goal condition was asked for; known: {', '.join(GOALS)}")
    one_of("world", world, plugins.names_in(plugins.WORLDS))
    one_of("record", record, RECORD)


def applicable_goals(methods: Sequence[str], conditions: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Those of the goal conditions that each method applies to, by what it declares.

    Raises:
        InputError: no method applies to any of them.
    """
    found = {}
    for method in methods:
        found[method] = tuple(filter(find_method(method).applies_to, conditions))
        if left_out := [condition for condition in conditions if condition not in found[method]]:
            print(
                f"NOTE {method} does not apply to {', '.join(left_out)} goals and is not tried on them", file=sys.stderr
            )
    if not any(found.values()):
        raise InputError(
            f"{', '.join(methods)} cannot be tried on {', '.join(conditions)} goals, to which it does not apply; "
            f"ask for other goals ({', '.join(GOALS)}) or other methods"
        )
    return found


def _carry_out(
    out: Path, ledger: Ledger, jobs: "Jobs", shared: EvaluationContext, planned: int, workers: int, address: str | None
) -> None:
    """Carry out jobs; a record is in the ledger before the next result is looked at, its recording before it."""
    if not len(jobs):
        return
    with progress("evaluate", planned, planned - len(jobs)) as advance:

        def keep(index: int, result: Outcome | Crashed) -> None:
            outcome = _lost(jobs.keys[index], jobs.source, shared, result) if isinstance(result, Crashed) else result
            if outcome.unrecorded is not None:
                print(f"NOTE {outcome.record.key.name} has no recording: {outcome.unrecorded}", file=sys.stderr)
            if outcome.recording is not None:
                place = recording_of(out, outcome.record.key.name)
                place.parent.mkdir(exist_ok=True)
                write_atomic(place, outcome.recording)
            ledger.add(outcome.record, outcome.configurations)
            advance()

        run_all(TrialWorker, shared, jobs, keep, workers, address, shared.planners)


@dataclass(frozen=True, eq=False)
class Jobs:
    """The jobs of some trials; a demonstration is read when its turn comes, so that few are held at a time."""

    source: DataSet
    keys: Sequence[TrialKey]

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: int) -> Job:
        return Job(self.keys[index], self.source.demonstration(self.keys[index].trial))


def carry_out_again(run: Path, key: TrialKey) -> Outcome:
    """Carry out a trial of the run in folder `run` once more, in this process, and record it: same seeds, same result.

    Raises:
        InputError: data set or model are no longer where they lay or not the same, or the package's version is another.
    """
    worker, jobs = once_more(run, [key])
    return worker(jobs[0])


def once_more(run: Path, keys: Sequence[TrialKey]) -> tuple[TrialWorker, Jobs]:
    """Who carries out trials of the run in folder `run` once more, in this process, recording them, and the jobs.

    Args:
        run: the run folder.
        keys: of trials in one world and seen in one way, at least one.

    Raises:
        InputError: data set or model are no longer where they lay or not the same, or the package's version is another.
    """
    _, shared, jobs = _again(run, keys, "all")
    return TrialWorker(shared), jobs


def repeat(run: Path, keys: Sequence[TrialKey], out: Path, workers: int, address: str | None = None) -> None:
    """Carry out trials of the run in folder `run` once more, into the run folder `out`; goes on where it was.

    Args:
        run: the run folder.
        keys: of trials in one world and seen in one way, at least one.
        out: a run folder, new or to be gone on with.
        workers: Ray actors; 0 works in this process.
        address: a running Ray cluster to join.

    Raises:
        InputError: data set or model are no longer where they lay or not the same, the package's version is another, or
            `out` is in use.
    """
    facts, shared, jobs = _again(run, keys, "none")
    settle_run(out, facts)
    with Ledger(ledger_of(out)) as ledger:
        ledger.plan(keys)
        there = ledger.keys()
        missing = [key for key in keys if key.digest not in there]
        _carry_out(out, ledger, Jobs(jobs.source, missing), shared, len(keys), workers, address)


def _again(run: Path, keys: Sequence[TrialKey], record: str) -> tuple[RunFacts, EvaluationContext, Jobs]:
    """What it takes to carry out trials of a run once more."""
    there, name = read_run(run), keys[0].name
    source, learned = DataSet.open(Path(there.data), allow_missing=bool(there.missing)), load_model(Path(there.model))
    settings = from_tables(there.settings, str(run / "run.json"))
    facts = _facts(source, learned, read_split(source, there.split), there.seed, settings, Path(there.model))
    if told := difference(there, facts):
        raise InputError(
            f"{name} cannot be carried out again: {run} was made with {told}; only what was recorded can be shown, "
            "unless the data set, the model and the version of cutgrammar are put back"
        )
    if any(key.origin != there.origin for key in keys):
        raise InputError(
            f"{name} cannot be carried out again: {run / 'run.json'} was changed since; put a good copy in its place"
        )
    methods = list(dict.fromkeys(key.method for key in keys))
    shared = _shared(there.seed, settings, learned, methods, keys[0].world, keys[0].perception, 1, record)
    return facts, shared, Jobs(source, keys)


def _shared(
    seed: int,
    settings: Settings,
    model: Model,
    methods: Sequence[str],
    world: str,
    perception: str,
    planners: int,
    record: str,
) -> EvaluationContext:
    return EvaluationContext(
        seed=seed,
        settings=settings,
        model=model,
        methods={name: plugins.reference_of(plugins.METHODS, name) for name in methods},
        world=plugins.reference_of(plugins.WORLDS, world),
        perception=perception,
        package=version("cutgrammar"),
        planners=planners,
        record=record,
        recorder=RECORDER,
        scores=computed_scores(),
    )


def _facts(source: DataSet, model: Model, split: Split, seed: int, settings: Settings, model_path: Path) -> RunFacts:
    return RunFacts(
        seed=seed,
        settings=asdict(settings),
        data_digest=source.digest,
        missing=source.missing,
        split=split.name,
        split_digest=split.digest,
        model_digest=model.digest,
        package=version("cutgrammar"),
        data=str(source.path.resolve()),
        model=str(model_path.resolve()),
        commit=_commit(),
        machine={
            "system": platform.platform(),
            "processor": platform.machine(),
            "cpus": os.cpu_count(),
            "python": platform.python_version(),
        },
    )


def _commit() -> str | None:
    """The commit of this code, with "+" if it was changed since; None where it does not lie in its own checkout."""
    file = Path(__file__)

    def git(*words: str) -> str | None:
        try:
            done = subprocess.run(["git", "-C", str(file.parent), *words], capture_output=True, text=True, check=False)
        except OSError:  # git is not installed
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    if not git("ls-files", "--error-unmatch", file.name):
        return None
    commit, changed = git("rev-parse", "HEAD"), git("status", "--porcelain", "--untracked-files=no")
    return f"{commit}+" if commit and changed else commit


def _planned(source: DataSet, split: Split, model: Model, setups: Sequence[str] | None, most: int | None) -> list[int]:
    """The test trials to carry out, setup by setup.

    Raises:
        InputError: an unknown setup or one without test trials, a trial that the model was trained on, or a goal that
            has fewer fragments than its start.
    """
    of_setup: dict[str, list[int]] = {name: [] for name in SETUPS}
    for number in sorted(split.test):
        summary = source.summary(number)
        of_setup[setup_named(summary.setup).name].append(number)
        if summary.fragments < len(summary.foods):
            raise InputError(
                f"trial {number} of {source.path}: its goal has {summary.fragments} fragments and its start "
                f"{len(summary.foods)}; cutting makes more, never fewer: leave this trial out of the split"
            )
    with_tests = [name for name, numbers in of_setup.items() if numbers]
    wanted = with_tests if setups is None else [setup_named(name).name for name in dict.fromkeys(setups)]
    for name in wanted:
        if name not in with_tests:
            raise InputError(
                f"setup {name} has no test trials in split {split.name!r} of {source.path}; "
                f"those that have some: {', '.join(with_tests)}"
            )
    chosen = [number for name in wanted for number in of_setup[name][:most]]
    if model.provenance.data == source.digest and (seen := set(chosen) & set(model.provenance.trials)):
        raise InputError(
            f"trial {min(seen)} tests in split {split.name!r}, but the model was trained on it; "
            f"use the split {model.provenance.split!r}, or train on this one"
        )
    return chosen


def _lost(key: TrialKey, source: DataSet, shared: EvaluationContext, crashed: Crashed) -> Outcome:
    """What stands for a trial of which nothing came back."""
    record = record_of_death(
        key,
        source.summary(key.trial).fragments,
        package=shared.package,
        reason=crashed.reason,
        traceback=crashed.traceback,
        scores=map(load_score, shared.scores.values()),
    )
    return Outcome(record, None)


def _summary(out: Path, keys: Sequence[TrialKey], new: int) -> Summary:
    wanted = set(keys)
    statuses = Counter(record.status for record in read_records(ledger_of(out)) if record.key in wanted)
    return Summary(
        planned=len(keys),
        present=statuses.total(),
        new=new,
        stuck=statuses["stuck"],
        failed=statuses["failed"],
        crashed=statuses["crashed"],
    )
