"""Where the records of a run come from: data set, model, settings, code and machine."""

import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from cutgrammar.learning.model import Model
from cutgrammar.plugins import METHODS, WORLDS, package_of, reference_of
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.run_folder import RunFacts, recordings_elsewhere
from cutgrammar.storage.shared_storage import absolute, is_url
from cutgrammar.storage.split import Split
from cutgrammar.trials.scores import computed_scores
from cutgrammar_pipelines.stages.evaluate.people import NOBODY, People
from cutgrammar_workers.trial_worker import EvaluationContext

RECORDER = "cutgrammar_dashboards.recording.recorder:Recorder"


def facts_of(
    source: DataSet,
    split: Split,
    model_digests: Sequence[str],
    model_places: Sequence[str | Path],
    seed: int,
    settings: Settings,
    people: People = NOBODY,
    data: str | Path | None = None,
    artifacts: str | None = None,
) -> RunFacts:
    """What all trials of a run have in common, as it is written to `run.json`.

    `data` is where the data set was read from, if that is another place than where it is open now.
    """
    return RunFacts(
        seed=seed,
        settings=asdict(settings),
        data_digest=source.digest,
        missing=source.missing,
        split=split.name,
        split_digest=split.digest,
        model_digests=tuple(model_digests),
        package=version("cutgrammar"),
        data=absolute(data or source.path),
        models=tuple(map(absolute, model_places)),
        commit=_commit(),
        machine={
            "system": platform.platform(),
            "processor": platform.machine(),
            "cpus": os.cpu_count(),
            "python": platform.python_version(),
        },
        human=people.found_at,
        human_digests=tuple(made.digest for made in people.sets),
        by_robot=people.by_robot,
        artifacts=None if artifacts is None else absolute(artifacts),
    )


def context_of(
    facts: RunFacts,
    settings: Settings,
    models: Mapping[str, Model],
    methods: Sequence[str],
    world: str,
    perception: str,
    planners: int = 1,
    record: str = "none",
) -> EvaluationContext:
    """What workers need to carry out trials of a run; names become references, which remote workers can import.

    Args:
        facts: of the run.
        settings: all of them.
        models: origin of trials -> the model that they use.
        methods, world, perception: by name.
        planners: number of processes that share each search.
        record: which trials are kept as recordings.

    Workers fetch a data set that is at a URL themselves, and write recordings to a run's other place for them.
    """
    elsewhere = {origin: place for origin in models if (place := recordings_elsewhere(facts, origin)) is not None}
    return EvaluationContext(
        seed=facts.seed,
        settings=settings,
        models=models,
        methods={name: reference_of(METHODS, name) for name in methods},
        world=reference_of(WORLDS, world),
        perception=perception,
        scores=computed_scores(),
        package=facts.package,
        planners=planners,
        record=record,
        recorder=RECORDER,
        versions=_versions(facts, methods),
        data=(facts.data, facts.data_digest) if is_url(facts.data) else None,
        artifacts=elsewhere,
    )


def _versions(facts: RunFacts, methods: Sequence[str]) -> dict[str, str]:
    """What only the driver knows: remote workers have the code of packages but not their metadata."""
    packages = {f"method {name}": package_of(METHODS, name) for name in methods}
    plugins = {name: package for name, package in packages.items() if package.partition(" ")[0] != "cutgrammar"}
    return {"cutgrammar": facts.package, "commit": facts.commit or "installed package", **plugins}


def _commit() -> str | None:
    """The commit of this code, with "+" if files were changed since; None outside its own git checkout."""
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
