"""Record: people cut foods on a page, and their demonstrations become a data set (IV-A)."""

import dataclasses
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path

from cutgrammar.atomic_files import json_bytes, refuse_occupied, write_atomic
from cutgrammar.demonstration import CATEGORIES
from cutgrammar.errors import InputError
from cutgrammar.plugins import load
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.differences import first_difference
from cutgrammar.storage.manifest import Manifest, reproduction_of
from cutgrammar.storage.shared_storage import local_folder
from cutgrammar.storage.split import read_split
from cutgrammar.trials.collection_plan import PlannedTrial, plan_trials
from cutgrammar.trials.setups import SETUPS
from cutgrammar.untrusted import read_json
from cutgrammar_dashboards.demonstrating.app import demonstration_page
from cutgrammar_dashboards.demonstrating.collection import Collection
from cutgrammar_dashboards.demonstrating.examples import example_picture
from cutgrammar_dashboards.demonstrating.task import Task, task_of
from cutgrammar_dashboards.pages.access import access_to
from cutgrammar_dashboards.pages.serving import bound_socket, serve
from cutgrammar_pipelines.config import RecordConfig
from cutgrammar_pipelines.stages.collect import foods_of, source_of
from cutgrammar_pipelines.stages.progress import status
from cutgrammar_sim.demonstrator.demonstrate import Food, definition_digest, lay_out_objects, make_demonstration

REQUEST = "record.json"
"""The file of the data set that holds what was asked for."""
EXAMPLES = 1_000_000
"""Examples are scripted demonstrations with trial numbers from here, which no task has."""


def record(config: RecordConfig) -> int:
    """Serve the demonstration page until it is interrupted; return 0 if every task is saved, otherwise 1.

    Raises:
        InputError: a food cannot be used, `out` holds something else, or the address cannot be used.
    """
    collection, examples = open_collection(config)
    listening = bound_socket(access_to(config.host, config.port, config.allowed_hosts).host, config.port)
    access = access_to(config.host, listening.getsockname()[1], config.allowed_hosts)
    saved, total = collection.progress
    status(f"{config.out} holds {saved} of {total} demonstrations")
    serve(demonstration_page(collection, examples), access, listening)
    saved, total = collection.progress
    status(f"{config.out} holds {saved} of {total} demonstrations")
    return 0 if saved == total else 1


def open_collection(config: RecordConfig) -> tuple[Collection, Mapping[str, bytes]]:
    """Create or resume the collection of a request; return it and an example picture for each category.

    Raises:
        InputError: a food or data set cannot be used, or `out` holds something else.
    """
    return _goals_to_reproduce(config, config.reproduce) if config.reproduce else _foods_to_cut(config)


def _goals_to_reproduce(config: RecordConfig, data: str) -> tuple[Collection, Mapping[str, bytes]]:
    if config.foods is not None:
        raise InputError("--reproduce takes the objects of its data set; leave out --foods")
    source = DataSet.open(local_folder(data))
    test = [source.summary(trial) for trial in read_split(source, config.split).test]
    setups = {setup: [one.trial for one in test if one.setup == setup] for setup in config.setups or SETUPS}
    by_turns = [trial for turn in zip_longest(*setups.values()) for trial in turn if trial is not None]
    trials = by_turns[: config.trials]
    if not trials:
        raise InputError(f"{data} has no test trials of these setups; choose other --setups or another --split")
    _claim(config.out, {"reproduces": source.digest, "split": config.split, "trials": trials})
    facts = Manifest(source.settings, source.seed, reproduction_of(source.digest), dict(source.foods), (), ())
    return Collection(config.out, trials, lambda trial: task_of(source.demonstration(trial)), facts), {}


def _foods_to_cut(config: RecordConfig) -> tuple[Collection, Mapping[str, bytes]]:
    planned = plan_trials(config.trials, config.setups)
    named = foods_of(config.foods, config.unit)
    foods: dict[str, Food] = {name: load(food) if isinstance(food, str) else food for name, food in named.items()}
    demonstrator = config.settings.demonstrator
    definition = definition_digest(demonstrator, [name for name, food in named.items() if isinstance(food, str)])
    sources = {name: source_of(food) for name, food in named.items()}
    request = {
        "seed": config.seed,
        "trials": config.trials,
        "setups": sorted({trial.setup.name for trial in planned}),
        "foods": sources,
        "definition": definition,
    }
    _claim(config.out, request)
    facts = Manifest(dataclasses.asdict(demonstrator), config.seed, f"by hand: {definition}", sources, (), ())
    examples = {
        category: example_picture(
            make_demonstration(EXAMPLES + i, SETUPS["N1M1"], (category,), foods, config.seed, demonstrator)
        )
        for i, category in enumerate(CATEGORIES)
        if any(category in trial.categories for trial in planned)
    }
    return (
        Collection(config.out, range(len(planned)), lambda trial: _task(planned[trial], foods, config.seed), facts),
        examples,
    )


def _task(planned: PlannedTrial, foods: Mapping[str, Food], seed: int) -> Task:
    objects = lay_out_objects(planned.trial, planned.setup, planned.categories, foods, seed)
    return Task(planned.trial, planned.setup.name, objects.categories, objects.foods, objects.jobs, objects.start, seed)


def _claim(out: Path, request: Mapping[str, object]) -> None:
    """Make the folder for this request, or check that it was made for the same."""
    file = out / REQUEST
    if file.exists():
        try:
            known = read_json(file)
        except ValueError as error:
            raise InputError(f"{file} is damaged ({error}); choose another --out") from None
        if not isinstance(known, dict):
            raise InputError(f"{file} is no request of record; choose another --out")
        difference = first_difference(known, request)
        if difference is not None:
            raise InputError(f"{out} was begun with another request: {difference}; choose another --out")
        return
    refuse_occupied(out)
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(file, json_bytes(request))
