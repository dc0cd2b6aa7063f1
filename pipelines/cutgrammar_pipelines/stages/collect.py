"""Collect: the scripted demonstrator cuts foods, in parallel, and what it did becomes a data set (IV-A)."""

import dataclasses
import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.files import read_food
from cutgrammar.plugins import FOODS, load, names_in, reference_of
from cutgrammar.settings import DemonstratorSettings, Settings
from cutgrammar.storage.data_set import DataSet, new_data_set
from cutgrammar.trials.collection_plan import PlannedTrial, plan_trials
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_sim.demonstrator.demonstrate import definition_digest, make_demonstration
from cutgrammar_sim.foods import ON_REQUEST
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.tasks import Crashed


@dataclass(frozen=True, eq=False)
class MeshFood:
    """A food that is always the same mesh, whatever the stream."""

    mesh: Mesh

    def __call__(self, _: np.random.Generator) -> Mesh:
        """The mesh."""
        return self.mesh


@dataclass(frozen=True)
class Shared:
    """What every demonstration of a data set has in common.

    Attributes:
        foods: name -> "module:attribute" of a food, or a mesh.
        seed: of the data set.
        settings: of the demonstrator.
    """

    foods: Mapping[str, str | MeshFood]
    seed: int
    settings: DemonstratorSettings


class Demonstrator:
    """Makes the demonstrations that are planned, one at a time; what comes out depends on the trial alone."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._foods = {name: load(food) if isinstance(food, str) else food for name, food in shared.foods.items()}

    def __call__(self, planned: PlannedTrial) -> Demonstration:
        """The demonstration of a planned trial."""
        return make_demonstration(
            planned.trial, planned.setup, planned.categories, self._foods, self._shared.seed, self._shared.settings
        )


def collect(
    out: Path,
    *,
    trials: int = 110,
    seed: int = 0,
    setups: Sequence[str] | None = None,
    foods: Sequence[str] | None = None,
    unit: str | None = None,
    workers: int = 0,
    address: str | None = None,
    settings: Settings | None = None,
) -> DataSet:
    """Make a data set; the same request gives the same bytes for any number of workers.

    Args:
        out: the folder to make. If it holds the very same data set already, nothing is done.
        trials: how many in all, spread over the setups in the proportions of the paper.
        seed: all randomness follows from it.
        setups: names of setups; None for all.
        foods: names of foods, or mesh files; None for all foods that are installed, but for those on request.
        unit: how to read the numbers in mesh files.
        workers: Ray actors to use; 0 works in this process.
        address: a running Ray cluster to join.
        settings: of the demonstrator; the defaults without.

    Raises:
        InputError: an unknown setup or food, a mesh that cannot be used, too few trials, `out` is in use, or the
            demonstrator failed at a trial; no data set is made then.

    Example:
        >>> data = collect(Path("data"), trials=20, foods=["carrot", "potato"])  # doctest: +SKIP
    """
    demonstrator = (settings or Settings()).demonstrator
    planned = plan_trials(trials, setups)
    shared = Shared(_named(foods, unit), seed, demonstrator)
    sources = {name: _source(food) for name, food in shared.foods.items()}
    definition = definition_digest(demonstrator, [name for name, food in shared.foods.items() if isinstance(food, str)])
    if (out / "manifest.json").exists():
        data = DataSet.open(out)
        trials_wanted = [(p.trial, p.setup.name, p.categories) for p in planned]
        if _request(data) == (dataclasses.asdict(demonstrator), seed, definition, sources, trials_wanted):
            print(f"{out} holds this data set already: {len(data.trials)} trials; nothing to do")
            return data
        raise InputError(
            f"{out} holds another data set ({len(data.trials)} trials, seed {data.seed}); choose another --out"
        )
    with (
        new_data_set(out, demonstrator, seed, sources, definition) as add,
        progress("collect", len(planned)) as advance,
    ):
        keep = _in_order(planned, add)

        def on_result(index: int, result: Demonstration | Crashed) -> None:
            keep(index, result)
            advance()

        run_all(Demonstrator, shared, planned, on_result, workers, address)
    data = DataSet.open(out)
    print(f"{out} holds {len(data.trials)} trials, {sum(trial.cuts for trial in data.trials)} cuts")
    return data


def _in_order(
    planned: Sequence[PlannedTrial], add: Callable[[Demonstration], None]
) -> Callable[[int, Demonstration | Crashed], None]:
    """Hands results that come in any order to `add` in order, as soon as those before them are there."""
    early: dict[int, Demonstration] = {}
    following = 0

    def keep(index: int, result: Demonstration | Crashed) -> None:
        nonlocal following
        if isinstance(result, Crashed):
            raise InputError(_failure(planned[index], result))
        early[index] = result
        while following in early:
            add(early.pop(following))
            following += 1

    return keep


def _failure(planned: PlannedTrial, crashed: Crashed) -> str:
    """One line on a demonstration that could not be made: which, why, where in the code, and what to try."""
    frames = re.findall(r'File "(.+)", line (\d+)', crashed.traceback)
    where = f" ({Path(frames[-1][0]).name}, line {frames[-1][1]})" if frames else ""
    what = f"{' and '.join(planned.categories)} in setup {planned.setup.name}"
    return (
        f"trial {planned.trial} ({what}) could not be demonstrated: {' '.join(crashed.reason.split())}{where}; "
        "leave out the food that cannot be cut so, or try another --seed"
    )


def _request(data: DataSet) -> tuple[object, ...]:
    """What a data set was asked to be."""
    trials = [(trial.trial, trial.setup, trial.categories) for trial in data.trials]
    return data.settings, data.seed, data.definition, data.foods, trials


def _named(foods: Sequence[str] | None, unit: str | None) -> dict[str, str | MeshFood]:
    """The foods asked for: references of those installed, meshes of files."""
    installed = names_in(FOODS)
    named: dict[str, str | MeshFood] = {}
    for food in [name for name in installed if name not in ON_REQUEST] if foods is None else foods:
        path = Path(food)
        is_file = food not in installed and (path.suffix != "" or path.name != food or path.is_file())
        name = path.stem if is_file else food
        if name in named:
            raise InputError(f"two foods are called {name!r}; name each once, and rename one of two files")
        named[name] = MeshFood(read_food(path, unit)) if is_file else reference_of(FOODS, food)
    if not named:
        raise InputError(f"no food was asked for; known: {', '.join(installed)}, or closed meshes as files")
    return named


def _source(food: str | MeshFood) -> str:
    """What stands behind a food, such that equal text means the same food."""
    if isinstance(food, str):
        return food
    digest = hashlib.sha256(food.mesh.vertices.tobytes() + food.mesh.faces.tobytes())
    return f"sha256:{digest.hexdigest()}"
