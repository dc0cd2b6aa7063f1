"""Train: everything is learned from the training trials of a split, and becomes a model folder.

The caller logs the result to MLflow (`tracking.log_training`).
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import check_place
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.grammar.text import describe
from cutgrammar.learning.learn import Learned, Watch
from cutgrammar.learning.model import Model, Provenance, load_model, save_model
from cutgrammar.learning.plane_validation import MAX_ANGLE_DEG
from cutgrammar.learning.settings_used import settings_used
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.differences import first_difference
from cutgrammar.storage.shared_storage import local_folder
from cutgrammar.storage.split import read_split
from cutgrammar.storage.stored_demonstrations import StoredDemonstrations
from cutgrammar.trials.news import Curve, Outlet, TrainingAdvanced, TrainingBegan
from cutgrammar_pipelines.config import TrainConfig
from cutgrammar_pipelines.stages.progress import progress, stages, status
from cutgrammar_pipelines.stages.watching import watched
from cutgrammar_workers.pool import run_all
from cutgrammar_workers.relays import MAX_SMALL
from cutgrammar_workers.tasks import Crashed
from cutgrammar_workers.training_worker import TrainingContext, TrainingWorker

MAX_MISSED = 0.25
"""Training warns if the planes miss a greater share of the first cuts of whole objects that they were trained on."""


@dataclass(frozen=True, eq=False)
class Trained:
    """The result of `train`.

    Attributes:
        path: the model's folder.
        model: the model in it.
        learned: how its parts were learned; None if the folder already held this model.
    """

    path: Path
    model: Model
    learned: Learned | None


def train(config: TrainConfig) -> Trained:
    """Learn a model from the training trials of a data set's split; the same arguments give the same bytes.

    Of the settings, those of features, induction, classifier, planes and baselines are used; with `config.vision` also
    those of the segmentation, the cameras and the world.

    Raises:
        InputError: no such data set or split, no training trial or no cut in them, or `config.out` is in use.

    Example:
        >>> trained = train(TrainConfig(data="data", out="model"))  # doctest: +SKIP
        >>> print(describe(trained.model.grammar))  # doctest: +SKIP
    """
    requested = _requested(config)
    if (config.out / "model.json").exists():
        return Trained(config.out, _existing(config, requested.provenance), None)
    check_place(config.out)
    with watched(config.watch, workers=0, max_waiting=MAX_SMALL) as outlet, _stages(outlet, config.out.name) as watch:
        shared = TrainingContext(requested.demonstrations(), config.settings, config.vision, watch)
        learned = TrainingWorker(shared)(requested.provenance)
    return _saved(config.out, learned)


def train_repeatedly(
    configs: Sequence[TrainConfig],
    on_trained: Callable[[Trained], Any],
    workers: int | None,
    address: str | None = None,
    py_modules: Sequence[Path] = (),
) -> None:
    """As `train`, for trainings that differ only in the seed and in `out`; finished models are not trained again.

    A model is saved, and `on_trained` called, as soon as it is learned.

    Args:
        configs: of the trainings.
        on_trained: is called here with the result of each training.
        workers: number of Ray actors that train at once; with 0 or 1, this process trains them in turn.
        address, py_modules: see `pool.run_all`.

    Raises:
        InputError: as `train`.
        RuntimeError: a training crashed.
    """
    remaining = [config for config in configs if not (config.out / "model.json").exists()]
    if workers in (0, 1) or len(remaining) < 2:
        for config in configs:
            on_trained(train(config))
        return
    for config in configs:
        if config not in remaining:
            on_trained(train(config))
        else:
            check_place(config.out)
    requested = [_requested(config) for config in remaining]
    demonstrations = requested[0].demonstrations()
    if address is not None:  # other nodes have no such files
        demonstrations = list(demonstrations)
    shared = TrainingContext(demonstrations, remaining[0].settings, remaining[0].vision)
    with progress("models", len(remaining)) as advance:

        def save(index: int, result: Learned | Crashed) -> None:
            if isinstance(result, Crashed):
                raise RuntimeError(f"training of {remaining[index].out}: {result.reason}\n{result.traceback}")
            on_trained(_saved(remaining[index].out, result))
            advance()

        provenances = [one.provenance for one in requested]
        run_all(TrainingWorker, shared, provenances, save, workers, address, py_modules=py_modules)


@dataclass(frozen=True, eq=False)
class _Requested:
    """What a training is made from."""

    source: DataSet
    provenance: Provenance

    def demonstrations(self) -> Sequence[Demonstration]:
        """Those of the training trials, each read when it is needed.

        Raises:
            InputError: there is no cut in them.
        """
        trials = self.provenance.trials
        if not any(self.source.summary(trial).cuts for trial in trials):
            name = self.provenance.split
            raise InputError(f"the training trials of split {name!r} of {self.source.path} hold no cut; collect more")
        return StoredDemonstrations(replace(self.source, path=self.source.path.resolve()), trials)


def _requested(config: TrainConfig) -> _Requested:
    source = DataSet.open(local_folder(config.data), config.allow_missing)
    trials = read_split(source, config.split)
    if not trials.train:  # trials in missing parts are left out already
        raise InputError(
            f"split {config.split!r} of {config.data} has no training trial; make another with cutgrammar split"
        )
    return _Requested(source, Provenance(source.digest, config.split, trials.digest, trials.train, config.seed))


def _saved(out: Path, learned: Learned) -> Trained:
    """Save what was learned, and print it."""
    save_model(learned.model, out)
    if warning := missed_first_cuts(learned.model):
        print(f"warning: {warning}", file=sys.stderr)
    status(f"{out} holds the model of {len(learned.model.provenance.trials)} training trials")
    status(describe(learned.model.grammar))
    return Trained(out, learned.model, learned)


def missed_first_cuts(model: Model) -> str | None:
    """What is wrong with the planes of `model` on the whole objects that it was trained on; None if all is well."""
    bad = [
        f"{model.metrics[metric]:.0%} ({methods})"
        for metric, methods in (("planes_missed_first_cuts", "grammar"), ("goal_planes_missed_first_cuts", "bc, qnet"))
        if model.metrics.get(metric, 0.0) > MAX_MISSED
    ]
    if not bad:
        return None
    return (
        f"the trained planes miss the demonstrated first cut of {' and '.join(bad)} of the training trials' whole "
        f"objects by more than {MAX_ANGLE_DEG:.0f} degrees; raise planes.epochs or baselines.plane_epochs, train with "
        "another --seed, or collect more trials"
    )


def _existing(config: TrainConfig, provenance: Provenance) -> Model:
    """The model in the folder of the training, if it is the requested one."""
    out, settings, vision = config.out, config.settings, config.vision
    model = load_model(out)
    if vision != (model.segmentation is not None):
        has, asked = ("no", "with") if vision else ("a", "without")
        raise InputError(f"{out} holds a model with {has} segmentation; train {asked} --vision into another --out")
    existing, wanted = (
        {"settings": asdict(settings_used(used, vision)), **asdict(origin)}
        for used, origin in ((model.settings, model.provenance), (settings, provenance))
    )
    if difference := first_difference(existing, wanted):
        raise InputError(f"{out} holds a model with {difference}; give the same, or choose another --out")
    status(f"{out} already holds this model; nothing to do")
    return model


@contextmanager
def _stages(outlet: Outlet | None, name: str) -> Iterator[Watch]:
    """A line for each stage; those who watch are told, too."""
    if outlet is not None:
        outlet(TrainingBegan(name))
    with stages() as line:

        def watch(stage: str, done: int, total: int, curve: Curve = ()) -> None:
            if outlet is not None:
                outlet(TrainingAdvanced(stage, done, total, curve))
            line(stage, done, total)

        yield watch
