"""Carry out the trials of an evaluation, and save the record of each in the ledger of the run folder."""

import contextlib
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError
from cutgrammar.methods.registry import find_method
from cutgrammar.storage.attempts import Attempt, differing_versions
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import Entry, Ledger, read_statuses
from cutgrammar.storage.run_folder import RunFacts, ledger_of, place_for_recording, recording_of, resumed, settle_run
from cutgrammar.storage.shared_storage import local_folder, remove_file
from cutgrammar.storage.split import read_split
from cutgrammar.trials.donors import DonorPool
from cutgrammar.trials.goals import FOREIGN
from cutgrammar.trials.record import TrialKey, record_of_death
from cutgrammar.trials.scores import load_score
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.arms import with_arm
from cutgrammar_pipelines.stages.evaluate.models import load_models
from cutgrammar_pipelines.stages.evaluate.people import NOBODY, People, open_people
from cutgrammar_pipelines.stages.evaluate.plan_trials import donor_pool, methods_of, plan_trials
from cutgrammar_pipelines.stages.evaluate.provenance import context_of, facts_of
from cutgrammar_pipelines.stages.progress import note, progress, status
from cutgrammar_pipelines.stages.watching import saved, tell_beginning, watched
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import MAX_FAULTS, START_SECONDS, Crashed, TimedOut
from cutgrammar_workers.trial_worker import EvaluationContext, Job, Outcome, TrialWorker

MAX_UNWRITTEN = 100
"""Most records that come together before they are written."""


@dataclass(frozen=True)
class Summary:
    """How an evaluation ended.

    Attributes:
        planned: number of trials planned.
        present: number of these that the ledger holds.
        new: number of these that this evaluation carried out.
        stuck, failed, crashed, timeout: numbers of trials that ended with this status.
        faults: number of attempts of this evaluation that faults of the machine ended.
    """

    planned: int
    present: int
    new: int
    stuck: int
    failed: int
    crashed: int
    timeout: int = 0
    faults: int = 0

    @property
    def complete(self) -> bool:
        """Whether every planned trial has its record."""
        return self.present == self.planned

    def __str__(self) -> str:
        if self.complete and not self.new:
            counts = f"already finished: all {self.planned} trials have a record"
        else:
            counts = f"{self.present} of {self.planned} trials have a record, {self.new} of them new"
        late = f", {self.timeout} out of time" if self.timeout else ""
        faults = f"; {self.faults} attempts ended by faults of the machine" if self.faults else ""
        return f"{counts}; {self.stuck} stuck, {self.failed} failed, {self.crashed} crashed{late}{faults}"


def evaluate(config: EvaluateConfig) -> Summary:
    """Carry out all trials that the run folder `config.out` does not hold yet.

    Raises:
        InputError: the data set, the model or the run folder cannot be used, or they do not fit together.

    Example:
        >>> from cutgrammar_pipelines.config import EvaluateConfig
        >>> evaluate(EvaluateConfig(data="data", model="model", out="run", world="bench"))  # doctest: +SKIP
    """
    source, models = DataSet.open(local_folder(config.data), config.allow_missing), load_models(config.model)
    for path, model in zip(config.model, models, strict=True):
        if config.perception == "cameras" and model.segmentation is None:
            raise InputError(
                f"the model {path} has no segmentation, which perception by cameras needs; "
                "train one with: cutgrammar train --vision"
            )
    settings = with_arm(config.settings, config.arm, config.flange)
    split = read_split(source, config.split or models[0].provenance.split)
    digests = [model.digest for model in models]
    people = open_people(config.human, source, config.data, config.test_robots)
    facts = facts_of(source, split, digests, config.model, config.seed, settings, people, config.data, config.artifacts)
    facts = resumed(config.out, facts)
    donors = donor_pool(source, split, models, config.seed)
    keys = plan_trials(config, source, split, models, facts, donors, people)
    context = context_of(
        facts,
        settings,
        dict(zip(facts.origins, models, strict=True)),
        methods_of(config),
        config.world,
        config.perception,
        config.planners,
        config.record,
    )
    jobs = Jobs(source, keys, donors, people, is_fetched=context.data is not None)
    with watched(config.watch, config.workers, config.address, config.py_module) as outlet:
        tell_beginning(outlet, config, keys)
        context = replace(context, outlet=outlet)
        new, faults = carry_out(
            config.out,
            facts,
            jobs,
            context,
            config.workers,
            config.address,
            config.py_module,
            config.retry,
            config.failure_budget,
            config.max_start_seconds,
        )
    summary = _summary(config.out, keys, new, faults)
    status(f"{config.out}: {summary}")
    return summary


@dataclass(frozen=True, eq=False)
class Jobs:
    """The jobs of some trials; a demonstration is read when its turn comes, so that few are in memory at a time.

    Attributes:
        source: the data set.
        keys: of the trials.
        donors: finds the donors of foreign goals.
        people: who reproduced which goals.
        is_fetched: whether workers read the demonstrations themselves.
    """

    source: DataSet
    keys: Sequence[TrialKey]
    donors: DonorPool
    people: People = NOBODY
    is_fetched: bool = False

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: int) -> Job:
        key = self.keys[index]
        donors = self.donors.objects(key.setup, key.trial, key.goals) if key.goals in FOREIGN else ()
        is_by_hand = self.people.sets and find_method(key.method).is_person  # finding takes a millisecond
        by_hand = self.people.reproduction(key.trial, key.run) if is_by_hand else None
        return Job(key, None if self.is_fetched else self.source.demonstration(key.trial), donors, by_hand)

    def goal_fragments(self, key: TrialKey) -> int:
        """The number of fragments in the goal of a trial."""
        if key.goals not in FOREIGN:
            return self.source.summary(key.trial).fragments
        return sum(len(donor.goal) for donor in self.donors.objects(key.setup, key.trial, key.goals))


def carry_out(
    out: Path,
    facts: RunFacts,
    jobs: Jobs,
    context: EvaluationContext,
    workers: int | None,
    address: str | None = None,
    py_modules: Sequence[Path] = (),
    retry: Sequence[str] = (),
    failure_budget: int = MAX_FAULTS,
    max_start_seconds: float = START_SECONDS,
) -> tuple[int, int]:
    """Carry out those of `jobs` that the run folder `out` does not hold.

    Records are in the ledger before the driver waits for the next result, those that came together in one transaction,
    and before them their recordings are on disk, or where `context` says. For `workers`, `address`, `py_modules` and
    `max_start_seconds` see `pool.run_all`. Trials that ended with a status in `retry` are carried out again; until they
    have a new record, the earlier one counts. Faults of the machine are repeated up to `failure_budget` times a trial,
    and are in the ledger as attempts.

    Returns:
        The number of trials that have a new record, and of faults of the machine.

    Raises:
        InputError: `out` holds a run that differs in `facts`, or something else.
    """
    settle_run(out, facts)
    with Ledger(ledger_of(out)) as ledger:
        ledger.plan(jobs.keys)
        again = ledger.keys(retry) if retry else set()
        present, planned = ledger.keys() - again, len(jobs)
        versions = context.versions_by_method()
        _tell_of_other_versions(out, ledger.attempts().versions, versions)
        jobs = replace(jobs, keys=[key for key in jobs.keys if key.digest not in present])
        if not len(jobs):
            return 0, 0
        for key in jobs.keys:
            if key.digest in again and key.origin in context.artifacts:  # it shows the earlier attempt
                remove_file(context.artifacts[key.origin], f"{key.name}.rrd")
        unfinished: list[TrialKey] = []
        unwritten: list[Entry] = []
        n_faults = 0
        with progress("evaluate", planned, planned - len(jobs)) as advance:

            def note_fault(index: int, fault: Crashed) -> None:
                nonlocal n_faults
                n_faults += 1
                attempt = Attempt(fault.host, fault.pid, None, time.time(), versions[jobs.keys[index].method])
                ledger.add_fault(jobs.keys[index], fault.reason, attempt)

            def save(index: int, result: Outcome | Crashed | TimedOut) -> None:
                key = jobs.keys[index]
                if isinstance(result, Crashed) and result.by_machine:
                    unfinished.append(key)
                    print(
                        f"NOTE {key.name} has no record, for the machine failed: {result.reason}; "
                        "the same command tries it again",
                        file=sys.stderr,
                    )
                    advance(failed=True)
                    return
                outcome = (
                    result if isinstance(result, Outcome) else _lost(jobs, key, context, versions[key.method], result)
                )
                if outcome.unrecorded is not None:
                    print(f"NOTE {outcome.record.key.name} has no recording: {outcome.unrecorded}", file=sys.stderr)
                if outcome.recording is not None:
                    write_atomic(place_for_recording(out, outcome.record.key.name), outcome.recording)
                elif key.digest in again:
                    recording_of(out, key.name).unlink(missing_ok=True)  # it shows the earlier attempt
                entry = Entry(outcome.record, outcome.configurations, outcome.attempt, key.digest in again)
                unwritten.append(entry)
                if len(unwritten) == MAX_UNWRITTEN:
                    write()

            def write() -> None:
                if not unwritten:
                    return
                ledger.add_all(unwritten)
                written = [entry.record for entry in unwritten]
                unwritten.clear()
                for record in written:
                    if context.outlet is not None:
                        context.outlet(saved(record))
                    advance(failed=record.status != "done")

            with contextlib.ExitStack() as at_the_end:
                at_the_end.callback(write)  # however the trials end
                run_all(
                    TrialWorker,
                    context,
                    jobs,
                    save,
                    workers,
                    address,
                    context.planners,
                    py_modules,
                    context.settings.trial.max_seconds,
                    failure_budget,
                    note_fault,
                    context.runs_plugins,
                    on_pause=write,
                    max_start_seconds=max_start_seconds,
                )
    return len(jobs) - len(unfinished), n_faults


def _tell_of_other_versions(
    out: Path, of_records: Sequence[tuple[Mapping[str, str], int]], now: Mapping[str, Mapping[str, str]]
) -> None:
    """Print what has other versions now than when records of the run were made."""
    of_now = [(versions, 0) for versions in now.values()]
    for name, counts in differing_versions([*of_records, *of_now]).items():
        current = {versions[name] for versions, _ in of_now if name in versions}
        old = {version: n for version, n in counts.items() if version not in current}
        if current and old:
            most, others = max(old, key=old.__getitem__), " and others" * (len(old) > 1)
            note(
                f"NOTE {sum(old.values())} records of {out} were made with {name} {most}{others}, "
                f"not {', '.join(sorted(current))}; the report counts them"
            )


def _lost(
    jobs: Jobs, key: TrialKey, context: EvaluationContext, versions: Mapping[str, str], lost: Crashed | TimedOut
) -> Outcome:
    """The outcome of a trial whose worker died or was stopped."""
    record = record_of_death(
        key,
        jobs.goal_fragments(key),
        package=context.package,
        model=context.models[key.origin].digest,
        status="crashed" if isinstance(lost, Crashed) else "timeout",
        reason=lost.reason,
        traceback=lost.traceback if isinstance(lost, Crashed) else "",
        scores=map(load_score, context.scores.values()),
    )
    return Outcome(record, None, attempt=Attempt(lost.host, lost.pid, None, time.time(), versions))


def _summary(out: Path, keys: Sequence[TrialKey], new: int, faults: int) -> Summary:
    known = read_statuses(ledger_of(out))
    statuses = Counter(known[digest] for digest in {key.digest for key in keys} if digest in known)
    return Summary(
        planned=len(keys),
        present=statuses.total(),
        new=new,
        stuck=statuses["stuck"],
        failed=statuses["failed"],
        crashed=statuses["crashed"],
        timeout=statuses["timeout"],
        faults=faults,
    )
