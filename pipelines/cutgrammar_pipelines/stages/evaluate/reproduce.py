"""Carry out trials of a run again: the same seeds give the same results."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.learning.model import load_model
from cutgrammar.settings import from_tables
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import RunFacts, difference, ledger_of, read_run
from cutgrammar.storage.shared_storage import local_folder
from cutgrammar.storage.split import read_split
from cutgrammar.trials.record import TrialKey
from cutgrammar_pipelines.stages.evaluate.people import open_people
from cutgrammar_pipelines.stages.evaluate.plan_trials import donor_pool
from cutgrammar_pipelines.stages.evaluate.provenance import context_of, facts_of
from cutgrammar_pipelines.stages.evaluate.run_trials import Jobs, carry_out
from cutgrammar_workers.trial_worker import EvaluationContext, Outcome, TrialWorker


def reproduce_trial(run: Path, key: TrialKey) -> Outcome:
    """Carry out a trial of the run in folder `run` again, in this process, and record it.

    Raises:
        InputError: the data set, the model or the package's version is missing or differs from that of the run.
    """
    worker, jobs = worker_for(run, [key])
    return worker(jobs[0])


def worker_for(run: Path, keys: Sequence[TrialKey], record: str = "all") -> tuple[TrialWorker, Jobs]:
    """A worker that carries out trials of the run in folder `run` again, and their jobs.

    Args:
        run: the run folder.
        keys: of trials in one world and with one perception, at least one.
        record: which trials it makes recordings of, one of `RECORD`.

    Raises:
        InputError: the data set, the model or the package's version is missing or differs from that of the run.
    """
    _, context, jobs = _reopen(run, keys, record)
    return TrialWorker(context), jobs


def reproduce_trials(run: Path, keys: Sequence[TrialKey], out: Path, workers: int, address: str | None = None) -> None:
    """Carry out trials of the run in folder `run` again, into the run folder `out`.

    Args:
        run: the run folder.
        keys: of trials in one world and with one perception, at least one.
        out: a run folder; created, or resumed if it exists.
        workers: number of Ray actors; 0 works in this process.
        address: a running Ray cluster to join.

    Raises:
        InputError: the data set, the model or the package's version is missing or differs from that of the run, or
            `out` is in use.
    """
    facts, context, jobs = _reopen(run, keys, "none")
    carry_out(out, facts, jobs, context, workers, address)


def _reopen(run: Path, keys: Sequence[TrialKey], record: str) -> tuple[RunFacts, EvaluationContext, Jobs]:
    """The facts of a run, and the context and the jobs that carry out some of its trials again."""
    facts, name = read_run(run), keys[0].name
    used = {key.origin for key in keys}
    source = DataSet.open(local_folder(facts.data), allow_missing=bool(facts.missing))
    settings = from_tables(facts.settings, str(run / "run.json"))
    models = {
        origin: load_model(local_folder(path))
        for origin, path in zip(facts.origins, facts.models, strict=True)
        if origin in used
    }
    digests = [
        models[origin].digest if origin in used else digest
        for origin, digest in zip(facts.origins, facts.model_digests, strict=True)
    ]
    split = read_split(source, facts.split)
    people = open_people(facts.human, source, facts.data, facts.by_robot)
    now = facts_of(source, split, digests, facts.models, facts.seed, settings, people, facts.data)
    if changed := difference(facts, now):
        raise InputError(
            f"{name} cannot be reproduced: {run} was made with {changed}; put back this data set, model and version "
            "of cutgrammar, or choose a trial that was recorded"
        )
    now = replace(now, settings=facts.settings)  # as the run wrote them, so that its trials keep their origin
    if not used <= set(facts.origins):
        raise InputError(
            f"{name} cannot be reproduced: {run / 'run.json'} was changed since; put a good copy in its place"
        )
    methods = list(dict.fromkeys(key.method for key in keys))
    context = context_of(now, settings, models, methods, keys[0].world, keys[0].perception, record=record)
    scored = {
        score for record in read_records(ledger_of(run), events=False) if record.key in keys for score in record.scores
    }
    scores = {name: reference for name, reference in context.scores.items() if name in scored}
    return (
        now,
        replace(context, scores=scores or context.scores, data=None),
        Jobs(source, keys, donor_pool(source, split, models.values(), facts.seed), people),
    )
