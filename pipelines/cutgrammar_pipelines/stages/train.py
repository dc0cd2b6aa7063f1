"""Train: everything is learned from the training trials of a split, and becomes a model folder.

The caller logs the result to MLflow (`tracking.log_training`).
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import check_place
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.grammar.text import describe
from cutgrammar.learning.learn import Learned, Watch, learn, settings_used
from cutgrammar.learning.model import Model, Provenance, load_model, save_model
from cutgrammar.learning.plane_validation import MAX_ANGLE_DEG
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.differences import first_difference
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.config import TrainConfig
from cutgrammar_pipelines.stages.progress import Advance, progress

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
    source = DataSet.open(config.data, config.allow_missing)
    trials = read_split(source, config.split)
    if not trials.train:  # trials in missing parts are left out already
        raise InputError(
            f"split {config.split!r} of {config.data} has no training trial; make another with cutgrammar split"
        )
    provenance = Provenance(source.digest, config.split, trials.digest, trials.train, config.seed)
    if (config.out / "model.json").exists():
        return Trained(config.out, _existing(config.out, config.settings, provenance, config.vision), None)
    return _learned(source, config.out, config.settings, provenance, config.vision)


def _learned(source: DataSet, out: Path, settings: Settings, provenance: Provenance, vision: bool) -> Trained:
    """Learn a model and save it."""
    check_place(out)
    demonstrations = [source.demonstration(trial) for trial in provenance.trials]
    if not any(not cut.undone for demonstration in demonstrations for cut in demonstration.cuts):
        raise InputError(
            f"the training trials of split {provenance.split!r} of {source.path} hold no cut; collect more"
        )
    with _stages() as watch:
        learned = learn(demonstrations, settings, provenance, watch, _scenes if vision else None)
    save_model(learned.model, out)
    if warning := missed_first_cuts(learned.model):
        print(f"warning: {warning}", file=sys.stderr)
    print(f"{out} holds the model of {len(demonstrations)} training trials")
    print(describe(learned.model.grammar))
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


def _scenes(
    demonstrations: Sequence[Demonstration], settings: Settings, seed: int, on_scene: Callable[[int], Any]
) -> list[LabelledCloud]:
    from cutgrammar_sim.worlds.scenes import seen_scenes  # simulator and cameras are needed only here

    return seen_scenes(demonstrations, settings, seed, settings.vision.n_scenes, on_scene)


def _existing(out: Path, settings: Settings, provenance: Provenance, vision: bool) -> Model:
    """The model in `out`, if it is the requested one."""
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
    print(f"{out} already holds this model; nothing to do")
    return model


@contextmanager
def _stages() -> Iterator[Watch]:
    """A progress bar for each stage, closed when the next stage begins."""
    with ExitStack() as bars:
        stage, so_far = "", 0
        advance: Advance

        def watch(name: str, done: int, total: int) -> None:
            nonlocal stage, so_far, advance
            if name != stage:
                bars.pop_all().close()
                stage, so_far = name, 0
                advance = bars.enter_context(progress(name, total))
            advance(done - so_far)
            so_far = done

        yield watch
