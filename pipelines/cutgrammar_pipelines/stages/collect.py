"""Collect: the scripted demonstrator cuts foods, in parallel, and its demonstrations become a data set (IV-A)."""

import dataclasses
import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError, listed
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.bodies import Keep
from cutgrammar.geometry.mesh_io.files import read_food
from cutgrammar.geometry.mesh_io.units import metres_of
from cutgrammar.plugins import FOODS, load, names_in, reference_of
from cutgrammar.settings import DemonstratorSettings
from cutgrammar.storage.begun import BegunDataSet, begun_data_set
from cutgrammar.storage.data_set import DataSet, new_data_set
from cutgrammar.storage.tables import Tables
from cutgrammar.trials.collection_plan import PlannedTrial, plan_trials
from cutgrammar_pipelines.config import CollectConfig
from cutgrammar_pipelines.stages.progress import progress, status
from cutgrammar_sim.demonstrator.demonstrate import definition_digest, make_demonstration
from cutgrammar_sim.foods import ON_REQUEST
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import Crashed

MAX_WAITING = 50
"""Most trials in memory that wait for an earlier one."""


@dataclass(frozen=True, eq=False)
class MeshFood:
    """A food that is always the same mesh; it draws nothing from the stream."""

    mesh: Mesh

    def __call__(self, _: np.random.Generator) -> Mesh:
        """The mesh."""
        return self.mesh


@dataclass(frozen=True)
class Context:
    """What all demonstrations of a data set have in common.

    Attributes:
        foods: name -> "module:attribute" of a food, or a mesh.
        seed: of the data set.
        settings: of the demonstrator.
    """

    foods: Mapping[str, str | MeshFood]
    seed: int
    settings: DemonstratorSettings


class Demonstrator:
    """Makes the planned demonstrations, one at a time; each depends on its trial alone."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._foods = {name: load(food) if isinstance(food, str) else food for name, food in context.foods.items()}

    def __call__(self, planned: PlannedTrial) -> Demonstration:
        """The demonstration of a planned trial."""
        return make_demonstration(
            planned.trial, planned.setup, planned.categories, self._foods, self._context.seed, self._context.settings
        )


def collect(config: CollectConfig) -> DataSet:
    """Make a data set, or finish one that was interrupted; the same request gives the same bytes in any case.

    Raises:
        InputError: a food or mesh cannot be used, too few trials, `out` is in use, or the demonstrator failed in a
            trial; no data set is made then.

    Example:
        >>> data = collect(CollectConfig(out="data", trials=20, foods=["carrot", "potato"]))  # doctest: +SKIP
    """
    out, seed, demonstrator = config.out, config.seed, config.settings.demonstrator
    planned = plan_trials(config.trials, config.setups)
    context = Context(foods_of(config.foods, config.unit, config.length, config.bodies), seed, demonstrator)
    sources = {name: source_of(food) for name, food in context.foods.items()}
    definition = definition_digest(
        demonstrator, [name for name, food in context.foods.items() if isinstance(food, str)]
    )
    if (out / "manifest.json").exists():
        data = DataSet.open(out)
        trials_wanted = [(p.trial, p.setup.name, p.categories) for p in planned]
        if _request(data) == (dataclasses.asdict(demonstrator), seed, definition, sources, trials_wanted):
            status(f"{out} already holds this data set: {len(data.trials)} trials; nothing to do")
            return data
        raise InputError(
            f"{out} holds another data set ({len(data.trials)} trials, seed {data.seed}); choose another --out"
        )
    request = (dataclasses.asdict(demonstrator), seed, definition, sources, [dataclasses.astuple(p) for p in planned])
    digest = hashlib.sha256(repr(request).encode()).hexdigest()
    with begun_data_set(out, digest) as begun, new_data_set(out, demonstrator, seed, sources, definition) as add:
        _fill(config, context, planned, begun, add)
    data = DataSet.open(out)
    status(f"{out} holds {len(data.trials)} trials, {sum(trial.cuts for trial in data.trials)} cuts")
    return data


def _fill(
    config: CollectConfig,
    context: Context,
    planned: Sequence[PlannedTrial],
    begun: BegunDataSet,
    add: Callable[[Tables], None],
) -> None:
    """Make the demonstrations that an interrupted run has not made, and pass all to `add` in order."""
    keep, kept = _in_order(add, lambda index: begun.load(planned[index].trial)), begun.trials()
    wanted = []
    for index, one in enumerate(planned):
        tables = begun.load(one.trial) if one.trial in kept else None
        if tables is None:
            wanted.append(index)
        else:
            keep(index, tables)
    if len(wanted) < len(planned):
        status(f"{config.out}: {len(planned) - len(wanted)} of {len(planned)} trials were made before")
    with progress("collect", len(planned), len(planned) - len(wanted)) as advance:

        def on_result(number: int, result: Demonstration | Crashed) -> None:
            index = wanted[number]
            if isinstance(result, Crashed):
                begun.clear()  # it would crash again
                raise InputError(_failure(planned[index], result))
            keep(index, begun.keep(result))
            advance()

        tasks = [planned[index] for index in wanted]
        run_all(Demonstrator, context, tasks, on_result, config.workers, config.address, py_modules=config.py_module)


def _in_order(add: Callable[[Tables], None], load: Callable[[int], Tables | None]) -> Callable[[int, Tables], None]:
    """Pass trials, which arrive in any order, to `add` in the order of their indices, each as early as possible.

    Few that wait for an earlier one are in memory; the others are loaded again.
    """
    waiting: dict[int, Tables | None] = {}
    next_index = 0

    def keep(index: int, tables: Tables) -> None:
        nonlocal next_index
        waiting[index] = tables if index == next_index or len(waiting) < MAX_WAITING else None
        while next_index in waiting:
            found = waiting.pop(next_index) or load(next_index)
            if found is None:
                raise OSError(f"the trial with number {next_index}, which was kept, cannot be read again")
            add(found)
            next_index += 1

    return keep


def _failure(planned: PlannedTrial, crashed: Crashed) -> str:
    """One line about a demonstration that failed: which, why, where in the code, and what to try."""
    frames = re.findall(r'File "(.+)", line (\d+)', crashed.traceback)
    where = f" ({Path(frames[-1][0]).name}, line {frames[-1][1]})" if frames else ""
    what = f"{' and '.join(planned.categories)} in setup {planned.setup.name}"
    return (
        f"trial {planned.trial} ({what}) could not be demonstrated: {' '.join(crashed.reason.split())}{where}; "
        "leave out this food, or try another --seed"
    )


def _request(data: DataSet) -> tuple[object, ...]:
    """The request that a data set was made for."""
    trials = [(trial.trial, trial.setup, trial.categories) for trial in data.trials]
    return data.settings, data.seed, data.definition, data.foods, trials


def foods_of(
    foods: Sequence[str] | None, unit: str | None, length: str | None = None, bodies: Keep = "all"
) -> dict[str, str | MeshFood]:
    """The foods requested: references of installed foods, meshes of files, read as `read_food` does."""
    metres = None if length is None else metres_of(length)
    installed = names_in(FOODS)
    named: dict[str, str | MeshFood] = {}
    for food in [name for name in installed if name not in ON_REQUEST] if foods is None else foods:
        path = Path(food)
        is_file = food not in installed and (path.suffix != "" or path.name != food or path.is_file())
        name = path.stem if is_file else food
        if name in named:
            raise InputError(f"two foods are called {name!r}; give each name once, and rename one of two files")
        named[name] = MeshFood(read_food(path, unit, bodies, metres)) if is_file else reference_of(FOODS, food)
    if not named:
        raise InputError(f"no food was given; known: {listed(installed)}, or closed meshes as files")
    return named


def source_of(food: str | MeshFood) -> str:
    """What a food is made of; equal text means the same food."""
    if isinstance(food, str):
        return food
    digest = hashlib.sha256(food.mesh.vertices.tobytes() + food.mesh.faces.tobytes())
    return f"sha256:{digest.hexdigest()}"
